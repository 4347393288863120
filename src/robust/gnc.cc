#include "inceres/solver/gnc.h"

#include "base/stopwatch.h"
#include "robust/graduation.h"
#include "robust/scaled_thresholds.h"
#include "robust/squared_errors.h"
#include "robust/weighted_problem.h"

namespace inceres {
namespace {

void Graduate(const GncOptions& options, const std::vector<FactorId>& suspects, FactorGraph* graph,
              GncSummary* summary) {
  summary->termination = Termination::kNoConvergence;
  internal::WeightedProblem problem(options, suspects, *graph, summary);
  internal::Graduation graduation(options, &problem);
  internal::ScaledThresholds thresholds(&problem, &graduation);
  if (graduation.SolveToTheEnd() && (!options.estimate_scale || thresholds.Solve())) {
    problem.Judge();
  }
  if (summary->IsSolutionUsable()) {
    problem.HandOver(graph);
  }
}

}  // namespace

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
