#include "tools/common/run_solver.h"

#include <chrono>
#include <memory>
#include <utility>

#include "inceres/ceres/solve.h"
#include "inceres/solver/solver.h"

namespace inceres::tools {
namespace {

template <typename Solve>
double Seconds(Solve solve) {
  const auto start = std::chrono::steady_clock::now();
  solve();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Status RunCeres(const RunPlan& plan, const ProblemSource& source, RunOutcome* outcome) {
  ceres::Solver::Options options;
  Status status = ToCeresOptions(plan.settings, plan.linear_solver, &options);
  if (!status.ok()) {
    return status;
  }
  ProblemSource::CeresInstance instance;
  status = source.MakeCeresInstance(plan.settings.robust, &instance);
  if (!status.ok()) {
    return status;
  }
  if (plan.landmarks_first) {
    options.linear_solver_ordering = instance.landmarks_first;
  }
  if (plan.progress != nullptr) {
    options.callbacks.push_back(plan.progress);
  }
  ceres::Solver::Summary summary;
  if (plan.engine == Engine::kStock) {
    const double seconds = Seconds([&] { ceres::Solve(options, instance.problem.get(), &summary); });
    outcome->record = RecordOf(summary, seconds);
  } else {
    SolveReport report;
    report.strict = plan.strict;
    const double seconds = Seconds([&] { inceres::Solve(options, instance.problem.get(), &summary, &report); });
    outcome->record = RecordOf(summary, report, seconds);
  }
  outcome->parameters = std::move(instance.parameters);
  return Status::Ok();
}

Status RunCore(const RunPlan& plan, const ProblemSource& source, RunOutcome* outcome) {
  SolverOptions options;
  Status status = ToCoreOptions(plan.settings, &options);
  if (!status.ok()) {
    return status;
  }
  options.observer = plan.progress;
  std::unique_ptr<FactorGraph> graph;
  status = source.MakeGraph(plan.settings.robust, &graph);
  if (!status.ok()) {
    return status;
  }
  Summary summary;
  const double seconds = Seconds([&] { summary = inceres::Solve(options, graph.get()); });
  outcome->record = RecordOf(summary, seconds);
  outcome->parameters = source.ParametersOf(*graph);
  return Status::Ok();
}

}  // namespace

Status Run(const RunPlan& plan, const ProblemSource& source, RunOutcome* outcome) {
  return plan.engine == Engine::kCore ? RunCore(plan, source, outcome) : RunCeres(plan, source, outcome);
}

}  // namespace inceres::tools
