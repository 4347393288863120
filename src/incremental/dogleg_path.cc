#include "incremental/dogleg_path.h"

#include <algorithm>
#include <cmath>

#include "trust_region/dogleg.h"

namespace inceres::internal {

// With η the gradient's negative over the variables that move and D² = diag H, the path is
//
//     0 → δ_sd = t D⁻²η → δ_gn,   t = ‖D⁻¹η‖² / ‖J D⁻²η‖²,
//
// where δ_gn is the damped step of the active set. D² has diag C of frames and diag P of landmarks,
// which are sums of squares: unlike diag S they cannot be negative. All others stay, so both ends
// of the path move the same variables, and a shorter step touches no factor that the long one has
// not touched: it costs an evaluation and no factorization. δ_gn and δ_sd are prepared once a step
// and kept until TrialStep::End; later calls only look for another point of the path.

namespace {

// Stands in for an entry of diag H that is zero.
constexpr double kLeastDiagonal = 1e-12;

}  // namespace

// The Cauchy point t D⁻²η with t = ‖D⁻¹η‖² / ‖J D⁻²η‖², over the active variables.
void DoglegPath::Prepare(const ActiveVariables& active, const ActiveBounds& bounds,
                         const std::vector<std::vector<std::int32_t>>& touched,
                         std::vector<IncrementalFamily>* families) {
  is_prepared_ = true;
  const AlignedVector<double>& step = active.step();
  // The step is overwritten by points of the path from now on.
  gauss_newton_.assign(step.begin(), step.end());
  // Holds η first: minus the gradient of the touched factors, which are all factors of what moves.
  cauchy_.assign(step.size(), 0.0);
  for (const IncrementalFamily& family : *families) {
    family.SubtractGradient(touched[family.id()], cauchy_.data());
  }
  // A touched factor has variables that stay put: their entries are no part of the direction.
  direction_.assign(step.size(), 0.0);
  double squared_gradient = 0.0;
  active.ForEachBlock([&](std::ptrdiff_t first, int size, const auto& diagonal) {
    const char* held = bounds.held(static_cast<std::int32_t>(first / kQuad));
    for (int k = 0; k < size; ++k) {
      // A coordinate that is held at a bound has no part in the descent.
      const double eta = held != nullptr && held[k] != 0 ? 0.0 : cauchy_[first + k];
      direction_[first + k] = eta / std::max(diagonal(k), kLeastDiagonal);
      // ηᵀD⁻²η = ‖D⁻¹η‖².
      squared_gradient += eta * direction_[first + k];
    }
  });
  // ‖J D⁻²η‖² from the products Jδ that PredictDecrease leaves with each factor. It overwrites
  // those of the refused step; Evaluate makes new ones for the shortened step.
  double curvature = 0.0;
  for (IncrementalFamily& family : *families) {
    family.PredictDecrease(touched[family.id()], direction_.data());
    for (const std::int32_t i : touched[family.id()]) {
      double slope = 0.0;
      double squared = 0.0;
      family.weighed().Slope(i, &slope, &squared);
      curvature += squared;
    }
  }
  // Without curvature along the gradient the model has no minimum there; the path then begins at
  // zero.
  const double t = curvature > 0.0 ? squared_gradient / curvature : 0.0;
  std::transform(direction_.begin(), direction_.end(), cauchy_.begin(),
                 [t](double entry) { return t * entry; });
}

void DoglegPath::Take(double scaled_norm, ActiveVariables* active) const {
  // ‖Dδ_sd‖², (Dδ_sd)ᵀD(δ_gn − δ_sd), ‖D(δ_gn − δ_sd)‖²
  double a = 0.0;
  double b = 0.0;
  double c = 0.0;
  active->ForEachBlock([&](std::ptrdiff_t first, int size, const auto& diagonal) {
    for (int k = 0; k < size; ++k) {
      const double difference = gauss_newton_[first + k] - cauchy_[first + k];
      a += diagonal(k) * cauchy_[first + k] * cauchy_[first + k];
      b += diagonal(k) * cauchy_[first + k] * difference;
      c += diagonal(k) * difference * difference;
    }
  });
  const double squared = scaled_norm * scaled_norm;
  // The point is alpha δ_sd + beta (δ_gn − δ_sd).
  double alpha = 1.0;  // of δ_sd
  double beta = 0.0;   // of δ_gn − δ_sd
  if (a >= squared) {
    // The Cauchy point is outside: the path is cut on its first leg. Where that point is zero there
    // is no first leg, and the only length that is not beyond it is zero too.
    alpha = a > 0.0 ? scaled_norm / std::sqrt(a) : 0.0;
  } else {
    // The clamp is for a radius beyond δ_gn, where the whole step is taken. Where both ends agree
    // any β will do.
    beta = c > 0.0 ? std::clamp(DoglegShare(squared, a, b, c), 0.0, 1.0) : 1.0;
  }
  AlignedVector<double>& step = active->step();
  active->ForEachBlock([&](std::ptrdiff_t first, int size, const auto& /*diagonal*/) {
    for (int k = 0; k < size; ++k) {
      step[first + k] =
          alpha * cauchy_[first + k] + beta * (gauss_newton_[first + k] - cauchy_[first + k]);
    }
  });
}

}  // namespace inceres::internal
