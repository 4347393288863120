#pragma once

#include <functional>
#include <vector>

#include "linearisation/factor_lineariser.h"
#include "schur/live_system.h"

namespace inceres::internal {

/// Rows of a live system's factors from its caches: the Jacobians of their last linearisation with the residuals and loss weights
/// of now. Where they would mislead there are none, and the factor is to be linearised: it has never been, or has changed; its
/// old linearisation errs by more than `limit` (squared, in units of the objective); its loss has lost all weight or has a
/// positive second-order term, which the caches leave out; or a Jacobian is asked for that they do not have.
class CachedRows {
 public:
  CachedRows(const LiveSystem& system, double limit) : system_(system), limit_(limit) {}

  /// True if the rows are in the result, which is valid until the next call. Jacobians of slots with wanted(id) are.
  bool Find(FactorId id, const std::function<bool(VariableId)>& wanted, LinearisedFactor* result);

 private:
  bool IsGood(const LiveFamily& family, FactorRef ref) const;

  const LiveSystem& system_;
  const double limit_;
  std::vector<double> f_;
  std::vector<std::vector<double>> jacobians_;  // per slot
  std::vector<SlotJacobians> slots_;
};

}  // namespace inceres::internal
