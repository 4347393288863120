#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "incremental/active_bounds.h"
#include "incremental/active_variables.h"
#include "linearize/incremental_family.h"

namespace inceres::internal {

/// The dog-leg path of an active set (docs/algorithms.md, "Damping and trust region of incremental
/// mode"): from where it is to the Cauchy point, and on to the Gauss–Newton step of the same
/// variables. Lengths are ‖Dδ‖, D² = diag H.
class DoglegPath {
 public:
  bool is_prepared() const { return is_prepared_; }
  /// Another step has begun.
  void Drop() { is_prepared_ = false; }

  /// The path whose end is the active variables' step. `touched`: per family, the factors that have
  /// one of them. One pass over these, whose predictions for a step (PredictDecrease) are
  /// overwritten. Coordinates held at bounds are no part of the gradient.
  void Prepare(const ActiveVariables& active, const ActiveBounds& bounds,
               const std::vector<std::vector<std::int32_t>>& touched,
               std::vector<IncrementalFamily>* families);
  /// The active variables' step := the point of the path at this length, or its end.
  void Take(double scaled_norm, ActiveVariables* active) const;

 private:
  bool is_prepared_ = false;
  AlignedVector<double> gauss_newton_;  // padded like the step
  AlignedVector<double> cauchy_;
  AlignedVector<double> direction_;  // D⁻²η
};

}  // namespace inceres::internal
