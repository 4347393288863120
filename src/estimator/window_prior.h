#pragma once

#include <utility>
#include <vector>

#include "inceres/estimator/sliding_window_estimator.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/marginalization.h"

namespace inceres::internal {

/// The prior that keeps what frames knew that have left the window, and variables of those that
/// have left but could not be marginalized yet.
class WindowPrior {
 public:
  /// Family −1 before there is one.
  FactorId factor() const { return factor_; }
  bool Touches(VariableId id) const;

  /// Marginalizes what is requested, and what was postponed; landmarks that cannot be are dropped
  /// instead, and `request` tells which. On an error nothing has left.
  Status Marginalize(const MarginalizationOptions& options, MarginalizationRequest* request,
                     IncrementalSolver* solver, WindowSummary* summary);
  /// Variables that are in no frame of the window, and still in the graph: the next
  /// marginalization takes them along.
  void Postpone(std::vector<VariableId> ids) { postponed_ = std::move(ids); }

 private:
  FactorId factor_;
  std::vector<VariableId> touched_;
  std::vector<VariableId> postponed_;
};

}  // namespace inceres::internal
