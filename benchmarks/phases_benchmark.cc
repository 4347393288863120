// Whole solves on simulated problems, 10 iterations with the built-in factors, with the milliseconds of each stage an iteration.
// For the comparison with stock Ceres see ab_compare.
//
//   build/bin/phases_benchmark

#include <memory>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/sim/street_scene.h"
#include "inceres/solver/solver.h"

namespace inceres {
namespace {

void BuildGraph(const BalProblem& problem, FactorGraph* graph) {
  auto family = std::make_shared<BalReprojectionFamily>();
  const FamilyId id = graph->AddFamily(family);
  std::vector<VariableId> cameras;
  std::vector<VariableId> points;
  for (int i = 0; i < problem.num_cameras; ++i) {
    cameras.push_back(graph->AddVariable(problem.cameras.data() + 9 * i, 9, Role::kFrame));
  }
  for (int i = 0; i < problem.num_points; ++i) {
    points.push_back(graph->AddVariable(problem.points.data() + 3 * i, 3, Role::kLandmark));
  }
  for (const auto& observation : problem.observations) {
    const VariableId variables[2] = {cameras[static_cast<std::size_t>(observation.camera)],
                                     points[static_cast<std::size_t>(observation.point)]};
    family->Add({observation.x, observation.y});
    graph->Connect(id, variables);
  }
}

void BM_Solve(benchmark::State& state, const std::string& preset) {
  StreetSceneOptions scene_options;
  StreetScene scene;
  if (!GetStreetScenePreset(preset, &scene_options).ok() || !GenerateStreetScene(scene_options, &scene).ok()) {
    state.SkipWithError("the scene could not be generated");
    return;
  }
  FactorGraph start;
  BuildGraph(scene.problem, &start);
  SolverOptions options;
  options.num_threads = static_cast<int>(state.range(0));
  options.max_num_iterations = 10;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  StageSeconds sum;
  double num_iterations = 0.0;
  for (auto _ : state) {
    FactorGraph graph = start;
    const Summary summary = Solve(options, &graph);
    num_iterations += static_cast<double>(summary.iterations.size());
    sum.setup += summary.seconds.setup;
    sum.residuals += summary.seconds.residuals;
    sum.jacobians += summary.seconds.jacobians;
    sum.hessian += summary.seconds.hessian;
    sum.elimination += summary.seconds.elimination;
    sum.factorization += summary.seconds.factorization;
    sum.back_substitution += summary.seconds.back_substitution;
    sum.model_cost += summary.seconds.model_cost;
  }
  const auto report = [&](const char* name, double seconds, double count) { state.counters[name] = 1e3 * seconds / count; };
  report("setup_ms", sum.setup, static_cast<double>(state.iterations()));
  report("residuals_ms", sum.residuals, num_iterations);
  report("jacobians_ms", sum.jacobians, num_iterations);
  report("hessian_ms", sum.hessian, num_iterations);
  report("elimination_ms", sum.elimination, num_iterations);
  report("factorization_ms", sum.factorization, num_iterations);
  report("back_substitution_ms", sum.back_substitution, num_iterations);
  report("model_cost_ms", sum.model_cost, num_iterations);
}
BENCHMARK_CAPTURE(BM_Solve, ladybug_like, "ladybug-like")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Solve, venice11, "venice11")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Solve, cathedral, "cathedral")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace inceres
