#include "tools/solve/run_solver.h"

#include <memory>
#include <type_traits>
#include <utility>

#include "inceres/ceres/solve.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "src/base/stopwatch.h"

namespace inceres::tools {
namespace {

using internal::SecondsOf;

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
  if (plan.progress != nullptr && !(plan.engine == Engine::kShim && plan.settings.incremental)) {
    options.callbacks.push_back(plan.progress);
  }
  ceres::Solver::Summary summary;
  if (plan.engine == Engine::kStock) {
    const double seconds =
        SecondsOf([&] { ceres::Solve(options, instance.problem.get(), &summary); });
    outcome->record = RecordOf(summary, seconds);
  } else {
    SolveOptions asked;
    SolveReport report;
    asked.strict = plan.strict;
    asked.max_memory_bytes = plan.settings.max_memory_bytes;
    asked.mode = plan.settings.incremental ? SolveMode::kIncremental : SolveMode::kExact;
    if (plan.settings.incremental && plan.settings.two_level) {
      asked.conjugate_gradients = TwoLevels(plan.settings);
    }
    ForgetStructures();  // a first call, as each of stock's is
    const double seconds = SecondsOf(
        [&] { inceres::Solve(options, instance.problem.get(), &summary, asked, &report); });
    outcome->record = RecordOf(summary, asked.mode, report, seconds);
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
  if (!options.recompute_jacobians) {
    options.observer = plan.progress;
  } else if (plan.progress != nullptr) {  // no observer goes with it
    options.progress = PrintLine;
  }
  std::unique_ptr<FactorGraph> graph;
  status = source.MakeGraph(plan.settings.robust, &graph);
  if (!status.ok()) {
    return status;
  }
  Summary summary;
  const double seconds = SecondsOf([&] { summary = inceres::Solve(options, graph.get()); });
  outcome->record = RecordOf(summary, seconds);
  outcome->parameters = source.ParametersOf(*graph);
  return Status::Ok();
}

// The whole graph as one edit. Families, manifolds and losses stay the graph's, which must outlive
// the solver.
Status CopyInto(IncrementalSolver* solver, const FactorGraph& graph) {
  const auto borrow = [](const auto* object) {
    return std::shared_ptr<std::remove_pointer_t<decltype(object)>>(std::shared_ptr<void>(),
                                                                    object);
  };
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    solver->AddFamily(borrow(&graph.family(family)));
  }
  GraphEdit edit(solver->graph());
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    edit.AddVariable(graph.Values(id), graph.AmbientSize(id), graph.role(id),
                     borrow(graph.manifold(id)));
    if (graph.IsConstant(id)) {
      edit.SetConstant(id, true);
    }
  }
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    for (int i = 0; i < graph.NumFactors(family); ++i) {
      edit.Connect(family, graph.Variables(family, i), borrow(graph.loss(family, i)));
    }
  }
  return solver->Apply(edit);
}

Status RunIncrementalCore(const RunPlan& plan, const ProblemSource& source, RunOutcome* outcome) {
  IncrementalOptions options;
  std::vector<std::string> without_effect;
  Status status = ToIncrementalOptions(plan.settings, &options, &without_effect);
  std::unique_ptr<FactorGraph> graph;
  if (status.ok()) {
    status = source.MakeGraph(plan.settings.robust, &graph);
  }
  if (!status.ok()) {
    return status;
  }
  IncrementalSolver solver(options);
  UpdateSummary summary;
  const double seconds = SecondsOf([&] {
    status = CopyInto(&solver, *graph);
    if (status.ok()) {
      summary = solver.Update();
    }
  });
  if (!status.ok()) {
    return status;
  }
  outcome->record = RecordOf(summary, seconds);
  outcome->record.options_without_effect = without_effect;
  for (VariableId id = 0; id < graph->num_variables(); ++id) {
    graph->SetValues(id, solver.Values(id));
  }
  outcome->parameters = source.ParametersOf(*graph);
  return Status::Ok();
}

}  // namespace

Status Run(const RunPlan& plan, const ProblemSource& source, RunOutcome* outcome) {
  if (plan.engine != Engine::kCore) {
    return RunCeres(plan, source, outcome);
  }
  return plan.settings.incremental ? RunIncrementalCore(plan, source, outcome)
                                   : RunCore(plan, source, outcome);
}

}  // namespace inceres::tools
