#pragma once

#include <functional>
#include <string>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "tools/replay/replay_ceres_problem.h"
#include "tools/replay/replay_solver.h"

namespace inceres::tools {

/// ceres::Solve, or what has its signature.
using CeresSolveFunction =
    std::function<void(const ceres::Solver::Options&, ceres::Problem*, ceres::Solver::Summary*)>;

/// ceres::Solve as a program that links Ceres calls it.
inline void PlainCeresSolve(const ceres::Solver::Options& options, ceres::Problem* problem,
                            ceres::Solver::Summary* summary) {
  ceres::Solve(options, problem, summary);
}

/// "dense_schur, landmarks first".
std::string DescribeLinearSolver(ceres::LinearSolverType type);

/// The options for a problem whose landmarks are these, or null: Schur solvers eliminate them
/// first, the others order as they will.
ceres::Solver::Options CeresOptions(
    const ReplaySettings& settings,
    const std::shared_ptr<ceres::ParameterBlockOrdering>& landmarks_first);

/// One solve, timed: the call alone, without what making its options takes.
ReplayOutcome TimeCeresSolve(const ceres::Solver::Options& options, ceres::Problem* problem,
                             const CeresSolveFunction& solve);

/// The same of a problem that grows.
ReplayOutcome SolveGrowing(const ReplaySettings& settings, ReplayCeresProblem* living,
                           const CeresSolveFunction& solve);

/// Whether a linear solver's name is one of a replay's, "dense_schur", "sparse_schur" or
/// "sparse_normal_cholesky", or "auto": of these the one that suits a problem with or without
/// landmarks. kInvalidArgument quotes any other after the flag's name.
Status ParseReplayLinearSolver(const std::string& flag, const std::string& name, bool landmarks,
                               ceres::LinearSolverType* type);

}  // namespace inceres::tools
