#include <cmath>

#include "inceres/solver/gnc.h"

namespace inceres {

// Quantiles of the chi-square distribution with n degrees: twice those of the gamma distribution
// with a = n/2. P(a, x) is summed by its series below a + 1 and taken from the continued fraction
// of 1 − P above, where each converges fast. The inverse is a bisection, for P is monotonic.

namespace {

// P(a, x) = γ(a, x)/Γ(a) below its bend, by the series of DLMF 8.11.4.
double LowerGammaBySeries(double a, double x, double scale) {
  double term = 1.0 / a;
  double sum = term;
  for (int n = 1; n < 10000 && term > 1e-17 * sum; ++n) {
    // Terms are positive and fall from some n on: the sum ends when they no longer count.
    term *= x / (a + n);
    sum += term;
  }
  return scale * sum;
}

// 1 − P(a, x) above it, by the continued fraction of DLMF 8.9.2 (Lentz's algorithm).
double UpperGammaByFraction(double a, double x, double scale) {
  // Where Lentz's algorithm would divide by zero it takes this instead.
  constexpr double kTiny = 1e-300;
  double b = x + 1.0 - a;
  double c = 1.0 / kTiny;
  // h is the product of the ratios of neighboring convergents; at a factor of 1 it has converged.
  double d = 1.0 / b;
  double h = d;
  for (int n = 1; n < 10000; ++n) {
    // The even part of the fraction: numerators −n (n − a), denominators x + 1 − a + 2n.
    const double numerator = -n * (n - a);
    b += 2.0;
    d = numerator * d + b;
    d = 1.0 / (std::fabs(d) < kTiny ? kTiny : d);
    c = b + numerator / c;
    c = std::fabs(c) < kTiny ? kTiny : c;
    h *= d * c;
    if (std::fabs(d * c - 1.0) < 1e-16) {
      break;
    }
  }
  return scale * h;
}

double LowerGamma(double a, double x) {
  if (x <= 0.0) {
    return 0.0;
  }
  // x^a e^−x / Γ(a) in logarithms, which neither overflow nor underflow on the way.
  const double scale = std::exp(a * std::log(x) - x - std::lgamma(a));
  // Each where it converges fast; they meet at x = a + 1.
  return x < a + 1.0 ? LowerGammaBySeries(a, x, scale) : 1.0 - UpperGammaByFraction(a, x, scale);
}

}  // namespace

double ChiSquareQuantile(double probability, int degrees) {
  const double a = 0.5 * degrees;
  double low = 0.0;
  double high = 1.0;
  // Doubles until the quantile is enclosed.
  while (high < 1e300 && LowerGamma(a, high) < probability) {
    high *= 2.0;
  }
  // To the last digits: the interval halves at most so often.
  for (int i = 0; i < 200 && high - low > 1e-15 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (LowerGamma(a, middle) < probability ? low : high) = middle;
  }
  return low + high;  // twice the middle: of the gamma distribution's argument
}

}  // namespace inceres
