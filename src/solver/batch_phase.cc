#include "solver/batch_phase.h"

#include <algorithm>

#include "inceres/solver/solver.h"

namespace inceres::internal {
namespace {

class StopOnRequest final : public SolveObserver {
 public:
  explicit StopOnRequest(const std::atomic<bool>& stop) : stop_(stop) {}
  ObserverAction EndOfIteration(const IterationSummary& /*summary*/, const double* /*best_state*/) override {
    return stop_.load(std::memory_order_relaxed) ? ObserverAction::kTerminateSuccessfully : ObserverAction::kContinue;
  }

 private:
  const std::atomic<bool>& stop_;
};

}  // namespace

bool TakesBatchPhase(const FactorGraph& graph) {
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    if (graph.NumFreePlaces(family) > 0) {
      return false;
    }
  }
  return graph.num_factors() > 0;
}

Termination RunBatchPhase(const IncrementalOptions& options, const std::atomic<bool>& stop, FactorGraph* graph,
                          UpdateSummary* summary) {
  SolverOptions batch;
  batch.strategy = options.batch_strategy;
  batch.num_threads = options.num_threads;
  // An iteration evaluates every factor twice: a candidate, and its Jacobians.
  const std::int64_t affordable = options.max_factor_evaluations / (2 * std::int64_t{graph->num_factors()});
  batch.max_num_iterations = static_cast<int>(std::min<std::int64_t>(options.max_num_iterations, affordable));
  batch.max_solver_time_in_seconds = options.max_seconds;
  batch.function_tolerance = options.function_tolerance;
  batch.parameter_tolerance = 0.0;  // a few points run off in bundle adjustment, and against them every step is short
  batch.initial_trust_region_radius = 1.0 / options.initial_damping;
  batch.min_relative_decrease = options.min_relative_decrease;
  StopOnRequest observer(stop);
  batch.observer = &observer;
  const Summary solved = Solve(batch, graph);
  summary->initial_cost = solved.initial_cost;
  summary->final_cost = solved.final_cost;
  summary->num_batch_iterations = static_cast<int>(solved.iterations.size()) - 1;
  summary->num_iterations = summary->num_batch_iterations;
  summary->num_rejected_steps = solved.num_unsuccessful_steps;
  summary->num_evaluated_factors = std::int64_t{solved.work.num_residual_evaluations} * graph->num_factors();
  summary->num_relinearised_factors = solved.work.num_jacobian_evaluations * graph->num_factors();
  summary->batch_seconds = solved.seconds.total;
  summary->message = solved.detail.empty() ? solved.message : solved.message + ": " + solved.detail;
  return solved.termination;
}

}  // namespace inceres::internal
