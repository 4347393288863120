#include "incremental/active_variables.h"

#include <algorithm>
#include <cmath>

namespace inceres::internal {

void ActiveVariables::Grow(std::int32_t num_quads) {
  frames_.Grow(schur_.frames().size());
  landmarks_.Grow(schur_.landmarks().size());
  const std::size_t entries = static_cast<std::size_t>(num_quads) * kQuad;
  if (entries > step_.size()) {
    step_.resize(entries, 0.0);
  }
}

// ‖Dδ‖, the length that the trust region measures: it does not depend on the variables' units.
double ActiveVariables::ScaledNorm() const {
  double squared = 0.0;
  ForEachBlock([&](std::ptrdiff_t first, int size, const auto& diagonal) {
    for (int k = 0; k < size; ++k) {
      squared += diagonal(k) * step_[first + k] * step_[first + k];
    }
  });
  return std::sqrt(squared);
}

// In the variables' own units, for the trace and the parameter tolerance.
double ActiveVariables::Norm() const {
  double squared = 0.0;
  ForEachBlock([&](std::ptrdiff_t first, int size, const auto& /*diagonal*/) {
    for (int k = 0; k < size; ++k) {
      squared += step_[first + k] * step_[first + k];
    }
  });
  return std::sqrt(squared);
}

DampedSquares ActiveVariables::FindDampedSquares(double mu, double lambda) const {
  DampedSquares sums;
  frames_.ForEach([&](std::int32_t i) {
    const double* C = schur_.FrameDiagonal(i);
    const double* moved = step(schur_.frames()[i].quad);
    for (int k = 0; k < schur_.frames()[i].size; ++k) {
      sums.like_frames += mu * mu * C[k] * moved[k] * moved[k];
    }
  });
  landmarks_.ForEach([&](std::int32_t l) {
    const IncrementalSchur::Landmark& landmark = schur_.landmarks()[l];
    const double* moved = step(landmark.quad);
    double squared = 0.0;
    for (int k = 0; k < landmark.size; ++k) {
      squared += schur_.blocks().D(l, k) * moved[k] * moved[k];
    }
    const double damping = schur_.blocks().lambda(l);
    const double damping_anew = std::max(damping, lambda);
    sums.like_frames += damping <= mu ? damping * damping * squared : 0.0;
    sums.more += damping_anew > mu ? damping_anew * damping_anew * squared : 0.0;
  });
  return sums;
}

void ActiveVariables::Stretch(std::int32_t landmark, double t) {
  const IncrementalSchur::Landmark& stretched = schur_.landmarks()[landmark];
  double* const begin = step(stretched.quad);
  std::for_each(begin, begin + stretched.size, [t](double& entry) { entry *= t; });
}

void ActiveVariables::LeaveOut(std::int32_t landmark) {
  landmarks_.Remove(landmark);
  std::fill_n(step(schur_.landmarks()[landmark].quad), schur_.landmarks()[landmark].size, 0.0);
}

// Zeros for the next step, whose factors read the steps of all their variables. Only of what moves:
// the vector is as long as the problem.
void ActiveVariables::Clear() {
  ForEach([this](const auto& moved) { std::fill_n(step(moved.quad), moved.size, 0.0); });
  frames_.Clear();
  landmarks_.Clear();
}

}  // namespace inceres::internal
