#include "inceres/solver/solver.h"

#include <algorithm>
#include <limits>
#include <new>

#include "base/executor.h"
#include "base/stopwatch.h"
#include "block/kernels.h"
#include "linearisation/evaluator.h"
#include "solver/linear_model.h"
#include "solver/trust_region_minimizer.h"

namespace inceres {
namespace {

using namespace internal;  // NOLINT(google-build-using-namespace): the one place where the public solver meets its parts

// Ceres's rule: the lowest cost seen, rejected candidates included; from the first iteration on whose cost is that of the factors
// as they are now.
double FinalCost(const Summary& summary, int first_iteration) {
  double cost = first_iteration == 0 ? summary.initial_cost : std::numeric_limits<double>::max();
  for (const IterationSummary& iteration : summary.iterations) {
    cost = iteration.iteration >= first_iteration ? std::min(cost, iteration.cost) : cost;
  }
  return cost;
}

// Nothing moves: the cost is that of the factors as they stand.
void SummarizeStandstill(const SolverOptions& options, const FactorGraph& graph, const Layout& layout, Summary* summary) {
  const Executor executor(options.num_threads);
  Evaluator evaluator(graph, layout, executor);
  double cost = 0.0;
  const Status evaluated = evaluator.EvaluateCandidateCost(&cost);
  if (!evaluated.ok()) {
    summary->message = "Residual and Jacobian evaluation failed.";
    summary->detail = evaluated.message;
    return;
  }
  summary->termination = Termination::kConvergence;
  summary->message = "Function tolerance reached. No non-constant parameter blocks found.";
  summary->initial_cost = summary->final_cost = cost + options.fixed_cost;
}

void SolveValid(const SolverOptions& options, FactorGraph* graph, Summary* summary, double start) {
  const bool eliminate = options.linear_model == LinearModelKind::kAutomatic || options.linear_model == LinearModelKind::kSchur;
  const Layout layout(*graph, eliminate);
  if (layout.variables.empty()) {
    SummarizeStandstill(options, *graph, layout, summary);
    return;
  }
  const Executor executor(options.num_threads);
  Evaluator evaluator(*graph, layout, executor);
  Status status;
  const std::unique_ptr<LinearModel> model = MakeLinearModel(options, evaluator, &summary->seconds, &status);
  if (!status.ok()) {
    summary->message = status.message;
    return;
  }
  summary->reduced_solver = model->SolverName();
  summary->work.bytes = evaluator.Bytes();
  model->Describe(&summary->work);
  summary->seconds.setup = NowInSeconds() - start;

  SolverOptions minimizer_options = options;
  minimizer_options.seconds_spent_before += summary->seconds.setup;
  TrustRegionMinimizer minimizer(minimizer_options, &evaluator, model.get(), summary);
  minimizer.Minimize();
  summary->final_cost = FinalCost(*summary, minimizer.first_comparable_iteration());
  if (summary->IsSolutionUsable()) {
    graph->mutable_state() = minimizer.best_state();
  }
}

}  // namespace

Summary Solve(const SolverOptions& options, FactorGraph* graph) {
  const double start = NowInSeconds();
  Summary summary;
  summary.fixed_cost = options.fixed_cost;
  summary.kernels = BestKernels().name;
  Status status = options.Validate();
  if (status.ok()) {
    status = graph->Validate();
  }
  try {
    if (status.ok()) {
      SolveValid(options, graph, &summary, start);
    } else {
      summary.message = status.message;
    }
  } catch (const std::bad_alloc&) {
    // The graph's state is written last, so it is untouched. What a user's factor throws is his and passes through.
    summary.termination = Termination::kFailure;
    summary.message = "Out of memory.";
  }
  summary.seconds.total = NowInSeconds() - start;
  return summary;
}

}  // namespace inceres
