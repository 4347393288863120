#include "solver/batch_phase.h"

#include <vector>

#include "inceres/solver/solver.h"

namespace inceres::internal {
namespace {

// What may be left, as a share of the function tolerance.
constexpr double kSettledShare = 0.1;

// Ends the solve on request, or when the work budget is spent.
class Limits final : public SolveObserver {
 public:
  Limits(const std::atomic<bool>& stop, std::int64_t max_evaluations, int num_factors)
      : stop_(stop), max_evaluations_(max_evaluations), num_factors_(num_factors) {}

  void BeforeEvaluation(const double* /*state*/, bool /*jacobians*/, bool /*new_point*/) override {
    num_evaluations_ += num_factors_;
  }
  ObserverAction EndOfIteration(const IterationSummary& /*summary*/, const double* /*best_state*/) override {
    const bool enough = stop_.load(std::memory_order_relaxed) || num_evaluations_ >= max_evaluations_;
    return enough ? ObserverAction::kTerminateSuccessfully : ObserverAction::kContinue;
  }

 private:
  const std::atomic<bool>& stop_;
  const std::int64_t max_evaluations_;
  const int num_factors_;
  std::int64_t num_evaluations_ = 0;
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
                           UpdateSummary* summary) {
  SolverOptions batch;
  batch.strategy = options.batch_strategy;
  batch.num_threads = options.num_threads;
  batch.max_num_iterations = options.max_num_iterations;
  batch.max_solver_time_in_seconds = options.max_seconds;
  batch.function_tolerance = options.function_tolerance;
  batch.parameter_tolerance = 0.0;  // a few points run off in bundle adjustment, and against them every step is short
  batch.initial_trust_region_radius = 1.0 / options.initial_damping;
  batch.min_relative_decrease = options.min_relative_decrease;
  Limits observer(stop, options.max_factor_evaluations, graph->num_factors());
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
  if (solved.termination == Termination::kUserSuccess || solved.termination == Termination::kNoConvergence) {
    summary->message = "Stopped by a limit or by request; the state is the best so far.";
    return {Termination::kNoConvergence, true};
  }
  return {solved.termination, HasSettled(solved, options.function_tolerance)};
}

}  // namespace inceres::internal
