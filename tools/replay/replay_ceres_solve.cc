#include "tools/replay/replay_ceres_solve.h"

#include <algorithm>
#include <cstdint>

#include "src/base/stopwatch.h"
#include "src/base/text.h"
#include "tools/command_line/command_line.h"

namespace inceres::tools {
namespace {

bool IsSchur(ceres::LinearSolverType type) {
  return type == ceres::DENSE_SCHUR || type == ceres::SPARSE_SCHUR;
}

ReplayOutcome OutcomeOf(const ceres::Solver::Summary& summary, double seconds) {
  ReplayOutcome outcome;
  outcome.usable = summary.IsSolutionUsable();
  outcome.termination = ceres::TerminationTypeToString(summary.termination_type);
  outcome.message = outcome.usable ? "" : summary.message;
  outcome.seconds = seconds;
  outcome.initial_cost = summary.initial_cost;
  outcome.final_cost = summary.final_cost;
  outcome.iterations = std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  std::int64_t invalid = 0;  // the linear solve or the evaluation failed; iteration 0 is the start
  for (std::size_t i = 1; i < summary.iterations.size(); ++i) {
    invalid += summary.iterations[i].step_is_valid ? 0 : 1;
  }
  outcome.work = {{"residual_evaluations", summary.num_residual_evaluations},
                  {"jacobian_evaluations", summary.num_jacobian_evaluations},
                  {"linear_solves", summary.num_linear_solves},
                  {"unsuccessful_steps", summary.num_unsuccessful_steps},
                  {"invalid_steps", invalid}};
  return outcome;
}

}  // namespace

std::string DescribeLinearSolver(ceres::LinearSolverType type) {
  return internal::LowerCase(ceres::LinearSolverTypeToString(type)) +
         (IsSchur(type) ? ", landmarks first" : "");
}

ceres::Solver::Options CeresOptions(
    const ReplaySettings& settings,
    const std::shared_ptr<ceres::ParameterBlockOrdering>& landmarks_first) {
  ceres::Solver::Options options;
  options.trust_region_strategy_type = settings.dogleg ? ceres::DOGLEG : ceres::LEVENBERG_MARQUARDT;
  options.linear_solver_type = settings.linear_solver;
  options.linear_solver_ordering = IsSchur(settings.linear_solver) ? landmarks_first : nullptr;
  options.num_threads = settings.num_threads;
  options.max_num_iterations = settings.max_num_iterations;
  options.function_tolerance = settings.function_tolerance;
  options.gradient_tolerance = settings.gradient_tolerance;
  options.parameter_tolerance = settings.parameter_tolerance;
  options.logging_type = ceres::SILENT;
  return options;
}

ReplayOutcome TimeCeresSolve(const ceres::Solver::Options& options, ceres::Problem* problem,
                             const CeresSolveFunction& solve) {
  ceres::Solver::Summary summary;
  const double seconds = internal::SecondsOf([&] { solve(options, problem, &summary); });
  return OutcomeOf(summary, seconds);
}

ReplayOutcome SolveGrowing(const ReplaySettings& settings, ReplayCeresProblem* living,
                           const CeresSolveFunction& solve) {
  return TimeCeresSolve(CeresOptions(settings, living->LandmarksFirst()), living->problem(), solve);
}

Status ParseReplayLinearSolver(const std::string& flag, const std::string& name, bool landmarks,
                               ceres::LinearSolverType* type) {
  return Choose(flag, name,
                {{"auto", landmarks ? ceres::DENSE_SCHUR : ceres::SPARSE_NORMAL_CHOLESKY},
                 {"dense_schur", ceres::DENSE_SCHUR},
                 {"sparse_schur", ceres::SPARSE_SCHUR},
                 {"sparse_normal_cholesky", ceres::SPARSE_NORMAL_CHOLESKY}},
                type);
}

}  // namespace inceres::tools
