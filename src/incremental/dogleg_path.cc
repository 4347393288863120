#include "incremental/dogleg_path.h"

#include <algorithm>
#include <cmath>

#include "trust_region/dogleg_point.h"

namespace inceres::internal {
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
  gauss_newton_.assign(step.begin(), step.end());
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
      const double eta = held != nullptr && held[k] != 0 ? 0.0 : cauchy_[first + k];
      direction_[first + k] = eta / std::max(diagonal(k), kLeastDiagonal);
      squared_gradient += eta * direction_[first + k];
    }
  });
  double curvature = 0.0;
  for (IncrementalFamily& family : *families) {
    family.PredictDecrease(touched[family.id()], direction_.data());
    for (const std::int32_t i : touched[family.id()]) {
      double slope = 0.0;
      double squared = 0.0;
      family.Slope(i, &slope, &squared);
      curvature += squared;
    }
  }
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
  double alpha = 1.0;  // of δ_sd
  double beta = 0.0;   // of δ_gn − δ_sd
  if (a >= squared) {
    alpha = scaled_norm / std::sqrt(a);
  } else {
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
