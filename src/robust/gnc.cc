#include "inceres/solver/gnc.h"

#include "base/stopwatch.h"
#include "robust/graduation.h"
#include "robust/scaled_thresholds.h"
#include "robust/squared_errors.h"
#include "robust/weighted_problem.h"

namespace inceres {

// Graduated non-convexity in batch mode (docs/algorithms.md, "Graduated non-convexity"): the order
// of its parts. WeightedProblem is a copy of the graph with weights, Graduation moves the weights
// from the convex cost to the robust one, ScaledThresholds does so again with tighter thresholds.
// The caller's graph is written at the end only, so a failure leaves it as it was.

namespace {

// Until something has ended it otherwise, the summary says that it did not converge. A failed solve
// has written its termination and message.
void Graduate(const GncOptions& options, const std::vector<FactorId>& suspects, FactorGraph* graph,
              GncSummary* summary) {
  summary->termination = Termination::kNoConvergence;
  internal::WeightedProblem problem(options, suspects, *graph, summary);
  internal::Graduation graduation(options, &problem);
  internal::ScaledThresholds thresholds(&problem, &graduation);
  if (graduation.SolveToTheEnd() && (!options.estimate_scale || thresholds.Solve())) {
    problem.Judge();
  }
  // Weights that have not settled are handed over too: state and losses then belong together.
  if (summary->IsSolutionUsable()) {
    problem.HandOver(graph);
  }
}

}  // namespace

// The first refusal ends it: options, graph, suspects.
GncSummary SolveGnc(const GncOptions& options, const std::vector<FactorId>& suspects,
                    FactorGraph* graph) {
  const double start = internal::NowInSeconds();
  GncSummary summary;
  Status status = options.Validate();
  status = status.ok() ? graph->Validate() : status;
  status = status.ok() ? internal::CheckSuspects(*graph, suspects) : status;
  if (status.ok()) {
    Graduate(options, suspects, graph, &summary);
  } else {
    summary.message = status.message;
  }
  summary.seconds = internal::NowInSeconds() - start;
  return summary;
}

}  // namespace inceres
