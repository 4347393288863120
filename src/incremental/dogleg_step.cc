// TrialStep::Shorten: the dog-leg path of an active set (docs/algorithms.md, "Damping and trust
// region of incremental mode").

#include <algorithm>
#include <cmath>

#include "incremental/trial_step.h"
#include "trust_region/dogleg_point.h"

namespace inceres::internal {
namespace {

// Stands in for an entry of diag H that is zero.
constexpr double kLeastDiagonal = 1e-12;

}  // namespace

// Calls visit(first entry in the padded vectors, size, function from coordinate to diag H) for
// every variable that moves.
template <typename Function>
void TrialStep::ForEachActive(Function&& visit) const {
  moved_.ForEach([&](std::int32_t i) {
    const double* C = schur_.FrameDiagonal(i);
    visit(std::ptrdiff_t{schur_.frames()[i].quad} * kQuad, schur_.frames()[i].size,
          [C](int k) { return C[k]; });
  });
  visited_.ForEach([&](std::int32_t l) {
    const IncrementalSchur::Landmark& landmark = schur_.landmarks()[l];
    const double* P = schur_.blocks().P(l);
    visit(std::ptrdiff_t{landmark.quad} * kQuad, landmark.size,
          [P](int k) { return P[k * kQuad + k]; });
  });
}

double TrialStep::ScaledNorm() const {
  double squared = 0.0;
  ForEachActive([&](std::ptrdiff_t first, int size, const auto& diagonal) {
    for (int k = 0; k < size; ++k) {
      squared += diagonal(k) * step_[first + k] * step_[first + k];
    }
  });
  return std::sqrt(squared);
}

double TrialStep::Norm() const {
  double squared = 0.0;
  ForEachActive([&](std::ptrdiff_t first, int size, const auto& /*diagonal*/) {
    for (int k = 0; k < size; ++k) {
      squared += step_[first + k] * step_[first + k];
    }
  });
  return std::sqrt(squared);
}

// The Cauchy point t D⁻²η with t = ‖D⁻¹η‖² / ‖J D⁻²η‖², over the active variables.
void TrialStep::PrepareDogleg() {
  dogleg_prepared_ = true;
  NameTouched();
  gauss_newton_.assign(step_.begin(), step_.end());
  cauchy_.assign(step_.size(), 0.0);
  for (const IncrementalFamily& family : families_) {
    family.SubtractGradient(touched_lists_[family.id()], cauchy_.data());
  }
  // A touched factor has variables that stay put: their entries are no part of the direction.
  direction_.assign(step_.size(), 0.0);
  double squared_gradient = 0.0;
  ForEachActive([&](std::ptrdiff_t first, int size, const auto& diagonal) {
    const char* held = bounds_.held(static_cast<std::int32_t>(first / kQuad));
    for (int k = 0; k < size; ++k) {
      const double eta = held != nullptr && held[k] != 0 ? 0.0 : cauchy_[first + k];
      direction_[first + k] = eta / std::max(diagonal(k), kLeastDiagonal);
      squared_gradient += eta * direction_[first + k];
    }
  });
  double curvature = 0.0;
  for (IncrementalFamily& family : families_) {
    family.PredictDecrease(touched_lists_[family.id()], direction_.data());
    for (const std::int32_t i : touched_lists_[family.id()]) {
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

void TrialStep::Shorten(double scaled_norm) {
  if (!dogleg_prepared_) {
    PrepareDogleg();
  }
  // ‖Dδ_sd‖², (Dδ_sd)ᵀD(δ_gn − δ_sd), ‖D(δ_gn − δ_sd)‖²
  double a = 0.0;
  double b = 0.0;
  double c = 0.0;
  ForEachActive([&](std::ptrdiff_t first, int size, const auto& diagonal) {
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
  ForEachActive([&](std::ptrdiff_t first, int size, const auto& /*diagonal*/) {
    for (int k = 0; k < size; ++k) {
      step_[first + k] =
          alpha * cauchy_[first + k] + beta * (gauss_newton_[first + k] - cauchy_[first + k]);
    }
  });
  moved_.ForEach(
      [this](std::int32_t i) { CutOff(schur_.frames()[i].id, schur_.frames()[i].quad); });
  visited_.ForEach(
      [this](std::int32_t l) { CutOff(schur_.landmarks()[l].id, schur_.landmarks()[l].quad); });
}

}  // namespace inceres::internal
