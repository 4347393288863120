#pragma once

#include <functional>
#include <vector>

#include "incremental/incremental_system.h"
#include "linearize/factor_linearizer.h"

namespace inceres::internal {

/// Rows of an incremental system's factors from its caches: the Jacobians of their last
/// linearization with the residuals and loss weights of now. Where they would mislead there are
/// none, and the factor is to be linearized: it has never been, or has changed; its old
/// linearization errs by more than `limit` (squared, in units of the objective); its loss has lost
/// all weight or has a positive second-order term, which the caches leave out; or a Jacobian is
/// asked for that they do not have.
class CachedRows {
 public:
  CachedRows(const IncrementalSystem& system, double limit) : system_(system), limit_(limit) {}

  /// True if the rows are in the result, which is valid until the next call. Jacobians of slots
  /// with wanted(id) are.
  bool Find(FactorId id, const std::function<bool(VariableId)>& wanted, LinearizedFactor* result);

 private:
  bool IsGood(const IncrementalFamily& family, FactorRef ref) const;
  void CopyJacobian(const IncrementalFamily& family, int factor, int slot, double scale);

  const IncrementalSystem& system_;
  const double limit_;
  std::vector<double> f_;
  std::vector<std::vector<double>> jacobians_;  // per slot
  std::vector<SlotJacobians> slots_;
};

}  // namespace inceres::internal
