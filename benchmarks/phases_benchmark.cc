// Whole solves on simulated problems, 10 iterations, with the milliseconds of each stage an
// iteration: ours with the built-in factors, ours on the ceres::Problem (exact mode) and stock
// Ceres on the same, the last two with AutoDiff cost functions. `linear_ms` is what Ceres calls its
// linear solver. For a comparison interleaved in time see ab_compare.
//
//   build/bin/phases_benchmark [--benchmark_filter=ladybug]

#include <memory>
#include <string>

#include <benchmark/benchmark.h>
#include <ceres/solver.h>

#include "inceres/ceres/solve.h"
#include "inceres/solver/solver.h"
#include "tools/problems/problem_source.h"
#include "tools/sim/street_scene.h"

namespace inceres {
namespace {

constexpr int kIterations = 10;

// The problem of a preset, or null and the benchmark is skipped.
std::unique_ptr<tools::BalSource> Scene(benchmark::State& state, const std::string& preset) {
  StreetSceneOptions options;
  StreetScene scene;
  if (!GetStreetScenePreset(preset, &options).ok() || !GenerateStreetScene(options, &scene).ok()) {
    state.SkipWithError("the scene could not be generated");
    return nullptr;
  }
  return std::make_unique<tools::BalSource>(std::move(scene.problem));
}

void Report(benchmark::State& state, const char* name, double seconds, double count) {
  state.counters[name] = 1e3 * seconds / count;
}

void BM_BuiltIn(benchmark::State& state, const std::string& preset) {
  const std::unique_ptr<tools::BalSource> source = Scene(state, preset);
  std::unique_ptr<FactorGraph> start;
  if (source == nullptr) {
    return;
  }
  if (!source->MakeGraph({}, &start).ok()) {
    state.SkipWithError("the graph could not be built");
    return;
  }
  SolverOptions options;
  options.num_threads = static_cast<int>(state.range(0));
  options.max_num_iterations = kIterations;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  StageSeconds sum;
  double num_iterations = 0.0;
  for (auto _ : state) {
    state.PauseTiming();
    auto graph = std::make_unique<FactorGraph>(*start);
    state.ResumeTiming();
    const Summary summary = Solve(options, graph.get());
    num_iterations += static_cast<double>(summary.iterations.size());
    sum.setup += summary.seconds.setup;
    sum.residuals += summary.seconds.residuals;
    sum.jacobians += summary.seconds.jacobians;
    sum.hessian += summary.seconds.hessian;
    sum.elimination += summary.seconds.elimination;
    sum.factorization += summary.seconds.factorization;
    sum.back_substitution += summary.seconds.back_substitution;
    sum.model_cost += summary.seconds.model_cost;
    state.PauseTiming();
    graph.reset();
    state.ResumeTiming();
  }
  Report(state, "setup_ms", sum.setup, static_cast<double>(state.iterations()));
  Report(state, "residuals_ms", sum.residuals, num_iterations);
  Report(state, "jacobians_ms", sum.jacobians, num_iterations);
  Report(state, "linear_ms",
         sum.hessian + sum.elimination + sum.factorization + sum.back_substitution, num_iterations);
  Report(state, "hessian_ms", sum.hessian, num_iterations);
  Report(state, "elimination_ms", sum.elimination, num_iterations);
  Report(state, "factorization_ms", sum.factorization, num_iterations);
  Report(state, "back_substitution_ms", sum.back_substitution, num_iterations);
  Report(state, "model_cost_ms", sum.model_cost, num_iterations);
}

using CeresSolve = void (*)(const ceres::Solver::Options&, ceres::Problem*,
                            ceres::Solver::Summary*);

void Exact(const ceres::Solver::Options& options, ceres::Problem* problem,
           ceres::Solver::Summary* summary) {
  SolveOptions asked;
  SolveReport report;
  asked.strict = true;
  Solve(options, problem, summary, asked, &report);
}

void BM_OnCeresProblem(benchmark::State& state, const std::string& preset, CeresSolve solve,
                       ceres::LinearSolverType linear_solver) {
  const std::unique_ptr<tools::BalSource> source = Scene(state, preset);
  if (source == nullptr) {
    return;
  }
  ceres::Solver::Options options;
  options.linear_solver_type = linear_solver;
  options.num_threads = static_cast<int>(state.range(0));
  options.max_num_iterations = kIterations;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  ceres::Solver::Summary sum;
  sum.preprocessor_time_in_seconds = sum.residual_evaluation_time_in_seconds = 0.0;
  sum.jacobian_evaluation_time_in_seconds = sum.linear_solver_time_in_seconds =
      sum.minimizer_time_in_seconds = 0.0;
  double num_iterations = 0.0;
  for (auto _ : state) {
    state.PauseTiming();
    tools::ProblemSource::CeresInstance instance;
    if (!source->MakeCeresInstance({}, &instance).ok()) {
      state.SkipWithError("the problem could not be built");
      break;
    }
    options.linear_solver_ordering = instance.landmarks_first;
    ForgetStructures();  // so that each solve of ours is a first one, as stock's are
    state.ResumeTiming();
    ceres::Solver::Summary summary;
    solve(options, instance.problem.get(), &summary);
    num_iterations += static_cast<double>(summary.iterations.size());
    sum.preprocessor_time_in_seconds += summary.preprocessor_time_in_seconds;
    sum.residual_evaluation_time_in_seconds += summary.residual_evaluation_time_in_seconds;
    sum.jacobian_evaluation_time_in_seconds += summary.jacobian_evaluation_time_in_seconds;
    sum.linear_solver_time_in_seconds += summary.linear_solver_time_in_seconds;
    sum.minimizer_time_in_seconds += summary.minimizer_time_in_seconds;
    state.PauseTiming();
    instance.problem.reset();
    state.ResumeTiming();
  }
  Report(state, "setup_ms", sum.preprocessor_time_in_seconds,
         static_cast<double>(state.iterations()));
  Report(state, "residuals_ms", sum.residual_evaluation_time_in_seconds, num_iterations);
  Report(state, "jacobians_ms", sum.jacobian_evaluation_time_in_seconds, num_iterations);
  Report(state, "linear_ms", sum.linear_solver_time_in_seconds, num_iterations);
  Report(state, "minimizer_ms", sum.minimizer_time_in_seconds, num_iterations);
}

#define INCERES_PHASES(name, preset)                                                           \
  BENCHMARK_CAPTURE(BM_BuiltIn, name, preset)                                                  \
      ->Arg(1)                                                                                 \
      ->Arg(2)                                                                                 \
      ->Unit(benchmark::kMillisecond)                                                          \
      ->UseRealTime();                                                                         \
  BENCHMARK_CAPTURE(BM_OnCeresProblem, name##_exact, preset, Exact, ceres::DENSE_SCHUR)        \
      ->Arg(1)                                                                                 \
      ->Arg(2)                                                                                 \
      ->Unit(benchmark::kMillisecond)                                                          \
      ->UseRealTime();                                                                         \
  BENCHMARK_CAPTURE(BM_OnCeresProblem, name##_stock, preset, ceres::Solve, ceres::DENSE_SCHUR) \
      ->Arg(1)                                                                                 \
      ->Arg(2)                                                                                 \
      ->Unit(benchmark::kMillisecond)                                                          \
      ->UseRealTime()

INCERES_PHASES(ladybug_like, "ladybug-like");
INCERES_PHASES(venice11, "venice11");
INCERES_PHASES(cathedral, "cathedral");

}  // namespace
}  // namespace inceres
