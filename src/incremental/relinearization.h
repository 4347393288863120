#pragma once

#include <algorithm>
#include <vector>

#include "inceres/solver/incremental_options.h"
#include "incremental/incremental_system.h"
#include "incremental/index_set.h"
#include "incremental/tuning.h"
#include "incremental/weak_variables.h"

namespace inceres::internal {

/// Which factors are linearized anew (docs/algorithms.md, "Relinearization"): those whose old
/// linearization errs by more than its share of the tolerance, before success those that
/// convergence may not rest on, and before a retreat those to blame.
class Relinearization {
 public:
  Relinearization(const Tuning::Relinearize& tuning, IncrementalSystem* system)
      : tuning_(tuning), system_(*system), weak_(&system->schur()) {}

  /// An Update begins; `share` is relinearization_share, resolved.
  void Begin(const IncrementalOptions& options, double share);

  /// Marks the touched factors whose old linearization errs too much, or whose weight has changed.
  void MarkStale(double tolerance);
  /// The same of factors that have taken another weight since they were looked at, whatever the
  /// rule: with more weight an old linearization errs more.
  void LookAt(const std::vector<FactorRef>& factors, double tolerance);
  /// Marks every factor whose old linearization is not good enough to claim convergence on, however
  /// long ago it became so: the tolerance may have been larger then. Those of weak variables are to
  /// be much better. True if there are any. Cost: what has aged and those variables, or all factors
  /// where the tolerance has fallen far since.
  bool RefreshAged(double tolerance) {
    const bool errs = RefreshErring(tolerance);
    return RefreshWeak(tuning_.strict_share * tolerance) || errs;
  }
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
    static ErrorLimits Of(const IncrementalFamily& family, int factor) {
      return {family.weighed().SquaredError(factor), family.weighed().SquaredGradientError(factor)};
    }
    bool ExceededBy(const IncrementalFamily& family, int factor) const {
      return family.weighed().SquaredError(factor) > model ||
             family.weighed().SquaredGradientError(factor) > squared_gradient;
    }
    bool IsBelow(const ErrorLimits& other) const {
      return model < other.model || squared_gradient < other.squared_gradient;
    }
    void RaiseTo(const ErrorLimits& other) {
      model = std::max(model, other.model);
      squared_gradient = std::max(squared_gradient, other.squared_gradient);
    }
  };
  ErrorLimits LimitsOf(double share, double tolerance) const;
  ErrorLimits AgedLimits(double tolerance) const {
    return LimitsOf(std::min(share_, tuning_.refresh_share), tolerance);
  }
  ErrorLimits BeginLooking(double tolerance);
  bool RefreshErring(double tolerance);
  bool RefreshWeak(double tolerance);
  void Judge(const IncrementalFamily& family, int factor, bool is_stale, const ErrorLimits& aged);
  void MakeRoom();
  void FindAged();

  const Tuning::Relinearize tuning_;
  IncrementalSystem& system_;
  WeakVariables weak_;
  double share_ = 0.0;
  RelinearizationRule rule_ = RelinearizationRule::kResidualError;
  double step_ = 0.0;  // of RelinearizationRule::kStepSize
  // the last step failed, and only its worst factors, or none, are linearized anew
  bool blamed_few_ = false;
  // Per family: linearized too long ago to claim convergence on, now or with a smaller tolerance.
  std::vector<IndexSet> aged_;
  ErrorLimits all_are_in_{0.0, 0.0};  // every factor that exceeds these is in `aged_`, or dirty
  ErrorLimits worst_{0.0, 0.0};       // none in `aged_` exceeds these
};

}  // namespace inceres::internal
