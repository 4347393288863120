#include "inceres/problem/losses.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace inceres {
namespace {

// A derivative that underflows to 0 would take the factor out of the system: keep it positive, as
// Ceres does.
double KeepPositive(double derivative) {
  return std::max(derivative, std::numeric_limits<double>::min());
}

void EvaluateOrIdentity(const Loss* loss, double s, double rho[3]) {
  if (loss != nullptr) {
    loss->Evaluate(s, rho);
    return;
  }
  rho[0] = s;
  rho[1] = 1.0;
  rho[2] = 0.0;
}

// log(1 + eˣ), without overflow for large x and without losing small eˣ.
double SoftPlus(double x) {
  return x > 0.0 ? x + std::log1p(std::exp(-x)) : std::log1p(std::exp(x));
}

}  // namespace

// The Huber weight: ρ' = 1 up to ‖f‖ = a, a/‖f‖ beyond.
void HuberLoss::Evaluate(double s, double rho[3]) const {
  if (s <= b_) {
    EvaluateOrIdentity(nullptr, s, rho);
    return;
  }
  const double norm = std::sqrt(s);
  rho[0] = 2.0 * a_ * norm - b_;
  rho[1] = KeepPositive(a_ / norm);
  rho[2] = -rho[1] / (2.0 * s);
}

void SoftLOneLoss::Evaluate(double s, double rho[3]) const {
  const double sum = 1.0 + s / b_;
  const double root = std::sqrt(sum);
  rho[0] = 2.0 * b_ * (root - 1.0);
  rho[1] = KeepPositive(1.0 / root);
  rho[2] = -rho[1] / (2.0 * b_ * sum);
}

void CauchyLoss::Evaluate(double s, double rho[3]) const {
  const double sum = 1.0 + s / b_;
  const double inverse = 1.0 / sum;
  rho[0] = b_ * std::log(sum);
  rho[1] = KeepPositive(inverse);
  rho[2] = -inverse * inverse / b_;
}

void ArctanLoss::Evaluate(double s, double rho[3]) const {
  const double ratio = s / a_;
  const double inverse = 1.0 / (1.0 + ratio * ratio);
  rho[0] = a_ * std::atan(ratio);
  rho[1] = KeepPositive(inverse);
  rho[2] = -2.0 * ratio / a_ * inverse * inverse;
}

TolerantLoss::TolerantLoss(double a, double b) : a_(a), b_(b), rho_at_zero_(b * SoftPlus(-a / b)) {
}

void TolerantLoss::Evaluate(double s, double rho[3]) const {
  const double x = (s - a_) / b_;
  const double decay = std::exp(
      -std::fabs(x));  // in (0, 1]: the logistic function from the side that cannot overflow
  const double logistic = (x > 0.0 ? 1.0 : decay) / (1.0 + decay);
  rho[0] = b_ * SoftPlus(x) - rho_at_zero_;
  rho[1] = KeepPositive(logistic);
  rho[2] = decay / ((1.0 + decay) * (1.0 + decay)) / b_;
}

void TukeyLoss::Evaluate(double s, double rho[3]) const {
  if (s > b_) {
    rho[0] = b_ / 3.0;
    rho[1] = 0.0;
    rho[2] = 0.0;
    return;
  }
  const double rest = 1.0 - s / b_;
  rho[0] = b_ / 3.0 * (1.0 - rest * rest * rest);
  rho[1] = rest * rest;
  rho[2] = -2.0 / b_ * rest;
}

void ScaledLoss::Evaluate(double s, double rho[3]) const {
  EvaluateOrIdentity(loss_.get(), s, rho);
  for (int k = 0; k < 3; ++k) {
    rho[k] *= scale_;
  }
}

// (f ∘ g)' = f' g',  (f ∘ g)'' = f'' g'² + f' g''.
void ComposedLoss::Evaluate(double s, double rho[3]) const {
  double rho_f[3];
  double rho_g[3];
  EvaluateOrIdentity(g_.get(), s, rho_g);
  EvaluateOrIdentity(f_.get(), rho_g[0], rho_f);
  rho[0] = rho_f[0];
  rho[1] = rho_f[1] * rho_g[1];
  rho[2] = rho_f[2] * rho_g[1] * rho_g[1] + rho_f[1] * rho_g[2];
}

}  // namespace inceres
