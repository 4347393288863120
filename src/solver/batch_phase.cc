#include "solver/batch_phase.h"

#include <algorithm>
#include <vector>

#include "inceres/solver/solver.h"

namespace inceres::internal {
namespace {

// What may be left, as a share of the function tolerance.
constexpr double kSettledShare = 0.1;

// Counts the work, writes the trace, and ends the solve when the Update's observer says so, on request, or when the work budget
// is spent.
class BatchObserver final : public SolveObserver {
 public:
  BatchObserver(const IncrementalOptions& options, const std::atomic<bool>& stop, int num_factors, const double** shown_state,
                UpdateTrace* trace)
      : options_(options), stop_(stop), num_factors_(num_factors), shown_state_(shown_state), trace_(*trace) {}
  ~BatchObserver() override { *shown_state_ = nullptr; }
  BatchObserver(const BatchObserver&) = delete;
  BatchObserver& operator=(const BatchObserver&) = delete;

  void BeforeEvaluation(const double* /*state*/, bool jacobians, bool /*new_point*/) override {
    UpdateSummary& summary = trace_.summary();
    if (jacobians) {
      summary.num_relinearised_factors += num_factors_;
    } else {
      summary.num_evaluated_factors += num_factors_;
    }
  }

  ObserverAction EndOfIteration(const IterationSummary& iteration, const double* best_state) override {
    cost_ = iteration.step_is_successful ? iteration.cost : cost_;
    WriteRow(iteration);
    *shown_state_ = best_state;
    const bool go_on = trace_.EndRow(cost_);
    *shown_state_ = nullptr;
    const UpdateSummary& summary = trace_.summary();
    if (!go_on) {
      ended_by_user_ = true;
      return summary.termination == Termination::kUserSuccess ? ObserverAction::kTerminateSuccessfully : ObserverAction::kAbort;
    }
    const bool enough = stop_.load(std::memory_order_relaxed) ||
                        summary.num_evaluated_factors + summary.num_relinearised_factors >= options_.max_factor_evaluations;
    return enough ? ObserverAction::kTerminateSuccessfully : ObserverAction::kContinue;
  }

  bool ended_by_user() const { return ended_by_user_; }

 private:
  void WriteRow(const IterationSummary& iteration) {
    UpdateIteration& row = trace_.row();
    row.step = iteration.iteration > 0 && iteration.step_is_valid ? UpdateStep::kBatch : UpdateStep::kNone;
    row.accepted = iteration.step_is_successful;
    row.cost_change = iteration.cost_change;
    row.predicted_change = iteration.model_cost_change;
    row.relative_decrease = iteration.relative_decrease;
    row.step_norm = iteration.step_norm;
    row.gradient_max_norm = iteration.gradient_max_norm;
    row.gradient_norm = iteration.gradient_norm;
    const bool damped = options_.batch_strategy == TrustRegionStrategyKind::kLevenbergMarquardt;
    row.damping = damped ? 1.0 / iteration.trust_region_radius : 0.0;
    row.radius = iteration.trust_region_radius;
    row.num_linear_solver_iterations = iteration.linear_solver_iterations;
    row.solve_seconds = iteration.step_solver_time_in_seconds;
  }

  const IncrementalOptions& options_;
  const std::atomic<bool>& stop_;
  const int num_factors_;
  const double** const shown_state_;
  UpdateTrace& trace_;
  double cost_ = 0.0;  // of the state
  bool ended_by_user_ = false;
};

// Ceres's rule looks at the last step alone. Steps whose gains fall by a ratio r leave gain · r / (1 − r) undone.
bool HasSettled(const Summary& summary, double function_tolerance) {
  if (summary.termination != Termination::kConvergence) {
    return false;
  }
  std::vector<double> gains;
  for (const IterationSummary& iteration : summary.iterations) {
    if (iteration.iteration > 0 && iteration.step_is_successful) {
      gains.push_back(iteration.cost_change);
    }
  }
  if (gains.size() < 2 || !(gains.back() >= 0.0) || !(gains[gains.size() - 2] > 0.0)) {
    return summary.final_cost == 0.0;
  }
  const double ratio = gains.back() / gains[gains.size() - 2];
  return ratio < 1.0 && gains.back() * ratio / (1.0 - ratio) <= kSettledShare * function_tolerance * summary.final_cost;
}

}  // namespace

bool TakesBatchPhase(const FactorGraph& graph) {
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    if (graph.NumFreePlaces(family) > 0) {
      return false;
    }
  }
  return graph.num_factors() > 0;
}

BatchOutcome RunBatchPhase(const IncrementalOptions& options, const std::atomic<bool>& stop, FactorGraph* graph,
                           const double** shown_state, UpdateTrace* trace) {
  UpdateSummary* summary = &trace->summary();
  SolverOptions batch;
  batch.strategy = options.batch_strategy;
  batch.num_threads = options.num_threads;
  batch.max_num_iterations = options.max_num_iterations;
  batch.max_solver_time_in_seconds = options.max_seconds;
  batch.function_tolerance = options.function_tolerance;
  batch.parameter_tolerance = 0.0;  // a few points run off in bundle adjustment, and against them every step is short
  batch.initial_trust_region_radius = 1.0 / options.initial_damping;
  batch.min_relative_decrease = options.min_relative_decrease;
  BatchObserver observer(options, stop, graph->num_factors(), shown_state, trace);
  batch.observer = &observer;
  const Summary solved = Solve(batch, graph);
  summary->initial_cost = solved.initial_cost;
  summary->final_cost = solved.final_cost;
  summary->num_batch_iterations = std::max(0, static_cast<int>(solved.iterations.size()) - 1);
  summary->num_iterations = summary->num_batch_iterations;
  summary->num_rejected_steps = solved.num_unsuccessful_steps;
  summary->batch_seconds = solved.seconds.total;
  summary->message = solved.detail.empty() ? solved.message : solved.message + ": " + solved.detail;
  if (observer.ended_by_user()) {
    return {solved.termination, true};
  }
  if (solved.termination == Termination::kUserSuccess || solved.termination == Termination::kNoConvergence) {
    summary->message = "Stopped by a limit or by request; the state is the best so far.";
    return {Termination::kNoConvergence, true};
  }
  return {solved.termination, HasSettled(solved, options.function_tolerance)};
}

}  // namespace inceres::internal
