#include "inceres/problem/losses.h"

#include <algorithm>
#include <cmath>
#include <limits>

// ρ, ρ', ρ'' of the built-in losses at s = ‖f‖² (docs/algorithms.md, "Robust losses"; definitions
// and parameters as in Ceres). A factor costs ½ρ(s); w = ρ' weights it, and ρ'' goes into the
// second-order correction in linearize/robustify.cc.

namespace inceres {
namespace {

// A derivative that underflows to 0 would take the factor out of the system: keep it positive, as
// Ceres does.
double KeepPositive(double derivative) {
  return std::max(derivative, std::numeric_limits<double>::min());
}

// A null loss stands for ρ(s) = s.
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
  // Up to a² it is the identity, to the last bit: inliers cost what they cost without a loss.
  if (s <= b_) {
    EvaluateOrIdentity(nullptr, s, rho);
    return;
  }
  const double norm = std::sqrt(s);
  rho[0] = 2.0 * a_ * norm - b_;
  rho[1] = KeepPositive(a_ / norm);
  // ρ'' = −ρ' / (2s): the curvature that a linear loss lacks, 1 + 2sρ''/ρ' = 0.
  rho[2] = -rho[1] / (2.0 * s);
}

void SoftLOneLoss::Evaluate(double s, double rho[3]) const {
  // ρ' = 1/√(1 + s/a²): Huber's weight in the limits of small and large s, without the corner
  // between.
  const double sum = 1.0 + s / b_;
  const double root = std::sqrt(sum);
  rho[0] = 2.0 * b_ * (root - 1.0);
  rho[1] = KeepPositive(1.0 / root);
  rho[2] = -rho[1] / (2.0 * b_ * sum);
}

void CauchyLoss::Evaluate(double s, double rho[3]) const {
  const double sum = 1.0 + s / b_;
  const double inverse = 1.0 / sum;
  // By log of the sum, as in Ceres.
  rho[0] = b_ * std::log(sum);
  rho[1] = KeepPositive(inverse);
  rho[2] = -inverse * inverse / b_;
}

void ArctanLoss::Evaluate(double s, double rho[3]) const {
  const double ratio = s / a_;
  const double inverse = 1.0 / (1.0 + ratio * ratio);
  rho[0] = a_ * std::atan(ratio);
  rho[1] = KeepPositive(inverse);
  // atan is bounded: the weight of an outlier goes to zero with 1/s².
  rho[2] = -2.0 * ratio / a_ * inverse * inverse;
}

// Subtracted so that ρ(0) = 0, whatever a and b are.
TolerantLoss::TolerantLoss(double a, double b) : a_(a), b_(b), rho_at_zero_(b * SoftPlus(-a / b)) {
}

void TolerantLoss::Evaluate(double s, double rho[3]) const {
  const double x = (s - a_) / b_;
  const double decay = std::exp(
      -std::fabs(x));  // in (0, 1]: the logistic function from the side that cannot overflow
  const double logistic = (x > 0.0 ? 1.0 : decay) / (1.0 + decay);
  rho[0] = b_ * SoftPlus(x) - rho_at_zero_;
  rho[1] = KeepPositive(logistic);
  // The derivative of the logistic function, symmetric in x: decay serves for both signs. It is
  // positive, for this loss is convex in s.
  rho[2] = decay / ((1.0 + decay) * (1.0 + decay)) / b_;
}

void TukeyLoss::Evaluate(double s, double rho[3]) const {
  // Beyond a it is constant: ρ' is exactly zero, and the factor has no influence at all.
  if (s > b_) {
    rho[0] = b_ / 3.0;
    rho[1] = 0.0;
    rho[2] = 0.0;
    return;
  }
  // rest = 1 − s/a² falls from 1 to 0 at the border, and ρ' and ρ'' with it: neither jumps there.
  const double rest = 1.0 - s / b_;
  rho[0] = b_ / 3.0 * (1.0 - rest * rest * rest);
  rho[1] = rest * rest;
  rho[2] = -2.0 / b_ * rest;
}

void ScaledLoss::Evaluate(double s, double rho[3]) const {
  EvaluateOrIdentity(loss_.get(), s, rho);
  // All three are linear in the scale.
  for (int k = 0; k < 3; ++k) {
    rho[k] *= scale_;
  }
}

// (f ∘ g)' = f' g',  (f ∘ g)'' = f'' g'² + f' g''.
void ComposedLoss::Evaluate(double s, double rho[3]) const {
  double rho_f[3];
  double rho_g[3];
  // The inner one first: its value is the argument of the outer one.
  EvaluateOrIdentity(g_.get(), s, rho_g);
  EvaluateOrIdentity(f_.get(), rho_g[0], rho_f);
  rho[0] = rho_f[0];
  rho[1] = rho_f[1] * rho_g[1];
  rho[2] = rho_f[2] * rho_g[1] * rho_g[1] + rho_f[1] * rho_g[2];
}

}  // namespace inceres
