#pragma once

#include <vector>

#include "inceres/solver/incremental_options.h"
#include "incremental/incremental_system.h"
#include "incremental/index_set.h"
#include "incremental/tuning.h"

namespace inceres::internal {

/// Which factors are linearized anew (docs/algorithms.md, "Relinearization"): those whose old
/// linearization errs by more than its share of the tolerance, before success those that
/// convergence may not rest on, and before a retreat those to blame.
class Relinearization {
 public:
  Relinearization(const Tuning::Relinearize& tuning, IncrementalSystem* system)
      : tuning_(tuning), system_(*system) {}

  /// An Update begins; `share` is relinearization_share, resolved.
  void Begin(const IncrementalOptions& options, double share);

  /// Marks the touched factors whose old linearization errs too much, or whose weight has changed.
  void MarkStale(double tolerance);
  /// Marks every factor whose old linearization is not good enough to claim convergence on. True if
  /// there are any.
  bool RefreshAged(double tolerance);
  /// The step failed: with old Jacobians about, it was perhaps their fault. Marks those whose
  /// factors' costs rose furthest above what was predicted of them, and all if the step before
  /// failed like this, or the step was not evaluated. True if there are any.
  bool RefreshTouched(bool evaluated);
  /// A step was taken: the next one that fails is the first.
  void Forgive() { blamed_few_ = false; }

 private:
  struct ErrorLimits {
    double model;
    double squared_gradient;
    bool ExceededBy(const IncrementalFamily& family, int factor) const {
      return family.SquaredError(factor) > model ||
             family.SquaredGradientError(factor) > squared_gradient;
    }
  };
  ErrorLimits LimitsOf(double share, double tolerance) const;

  const Tuning::Relinearize tuning_;
  IncrementalSystem& system_;
  double share_ = 0.0;
  RelinearizationRule rule_ = RelinearizationRule::kResidualError;
  double step_ = 0.0;  // of RelinearizationRule::kStepSize
  // the last step failed, and only its worst factors, or none, are linearized anew
  bool blamed_few_ = false;
  std::vector<IndexSet> aged_;  // per family: linearized too long ago to claim convergence on
};

}  // namespace inceres::internal
