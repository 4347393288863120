#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "inceres/solver/incremental_solver.h"
#include "incremental/incremental_minimizer.h"
#include "incremental/incremental_system.h"
#include "incremental/latest_value.h"
#include "incremental/live_covariance.h"
#include "incremental/tuning.h"
#include "incremental/undamped_factor.h"
#include "incremental/update_trace.h"

namespace inceres {

/// What IncrementalSolver is made of: its graph, the living system once one is needed, and what is
/// known of both between Updates.
class IncrementalSolver::Impl {
 public:
  explicit Impl(const IncrementalOptions& options) : options_(options) {}

  void SetOptions(const IncrementalOptions& options);
  Status Apply(const GraphEdit& edit);
  MarginalizationSummary Marginalize(const MarginalizationRequest& request,
                                     const MarginalizationOptions& options);
  void Update(UpdateSummary* summary, UpdateObserver* observer);
  ReducedStructure Structure();
  Status Covariance(const std::vector<VariableId>& ids, const LiveCovarianceOptions& options,
                    LiveCovariance* covariance);
  void PublishSnapshot(Termination termination);
  bool ReadSnapshot(ValueSnapshot* snapshot);
  double cost() const { return cost_; }
  const double* Values(VariableId id) const {
    return shown_state_ != nullptr ? graph.ValuesIn(shown_state_, id)
           : live != nullptr       ? live->variables().current(id)
                                   : graph.Values(id);
  }

  FactorGraph graph;
  // Null until it is needed: a problem that is solved once, in batch, never needs it.
  std::unique_ptr<internal::IncrementalSystem> live;
  std::atomic<bool> stop{false};

 private:
  void MinimizeOrPutBack(internal::UpdateTrace* trace);
  void TakeValues();
  void Form();
  void Restart();
  void Minimize(internal::UpdateTrace* trace);
  bool SolveInBatch(internal::UpdateTrace* trace);
  void Abandon(double start_cost, internal::UpdateTrace* trace);
  Status PrepareAnew(bool factorize);

  IncrementalOptions options_;
  Status valid_ = options_.Validate();
  const internal::Tuning tuning_ = internal::TuningOfNewSolvers();
  std::unique_ptr<internal::IncrementalMinimizer> minimizer_;
  std::vector<std::int32_t> changed_rows_;  // of S, by the last Update
  std::vector<double> start_state_;      // of an Update with an observer, which may ask for it back
  const double* shown_state_ = nullptr;  // the batch solver's, while the observer is called
  double cost_ = 0.0;
  bool converged_ = false;  // and nothing edited since
  // what converged was the batch solver, with a trust region so small that the next may go on
  bool held_back_ = false;
  bool begun_ = false;  // an Update was made
  // since the last Update that did not fail; there is none
  bool edited_ = true;
  internal::WeakestDirection weakest_;
  std::unique_ptr<internal::UndampedFactor> undamped_;  // of the system that lives
  // the batch solver was the last to move, and there was no incremental system
  bool in_batch_ = false;
  internal::LatestValue<ValueSnapshot> snapshots_;
  std::int64_t num_snapshots_ = 0;
};

}  // namespace inceres
