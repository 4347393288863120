#include <algorithm>
#include <cmath>

#include "inceres/problem/manifolds.h"

namespace inceres {

// A pose and a scale that is multiplied, s e^σ: additive steps could take it through zero. Pose and
// scale do not mix, neither in Plus nor in its derivative, so the former is PoseManifold's.

namespace {

// Beyond it e^σ is next to what a double holds: a step by a large gradient stays a point.
constexpr double kLargestStep = 300.0;

}  // namespace

bool SimilarityManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  // Before the pose is written: x and x_plus_delta may be the same.
  const double scale = x[7] * std::exp(std::clamp(delta[6], -kLargestStep, kLargestStep));
  if (!PoseManifold().Plus(x, delta, x_plus_delta)) {
    return false;
  }
  x_plus_delta[7] = scale;
  // A scale that overflows is no point of the manifold: the step has failed.
  return std::isfinite(scale);
}

bool SimilarityManifold::PlusJacobian(const double* x, double* jacobian) const {
  double of_pose[42];
  if (!PoseManifold().PlusJacobian(x, of_pose)) {
    return false;
  }
  // 8 × 7, row-major. Rows 0 to 6 have PoseManifold's 7 × 6 block; ∂(s e^σ)/∂σ = s at σ = 0.
  std::fill_n(jacobian, 56, 0.0);
  for (int r = 0; r < 7; ++r) {
    std::copy_n(of_pose + 6 * r, 6, jacobian + 7 * r);
  }
  jacobian[7 * 7 + 6] = x[7];
  return true;
}

bool SimilarityManifold::Minus(const double* y, const double* x, double* delta) const {
  // Scales on different sides of zero have no difference: the logarithm is no number.
  delta[6] = std::log(y[7] / x[7]);
  return PoseManifold().Minus(y, x, delta) && std::isfinite(delta[6]);
}

}  // namespace inceres
