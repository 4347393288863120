#pragma once

#include <functional>
#include <string>

#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "inceres/ceres/solve.h"
#include "src/base/available_memory.h"

namespace inceres::internal {

/// What a solve is called with, and where it writes.
struct SolveCall {
  const ceres::Solver::Options& options;
  ceres::Problem* problem;
  ceres::Solver::Summary* summary;
  const SolveOptions& solve_options;
  SolveReport* report;
};

/// Stock Ceres's solver. The member function is called, not the free ceres::Solve: the free one
/// goes through the member, so whoever replaces the member must never be reached from here by way
/// of the free one.
void SolveWithStock(const ceres::Solver::Options& options, ceres::Problem* problem,
                    ceres::Solver::Summary* summary);

/// A problem we do not solve: stock Ceres does, unless the caller is strict. Requires that nothing
/// of the user's has been called or written so far.
void Decline(const SolveCall& call, const std::string& reason);

/// Why these options cannot be honored here, or an empty string. Looks at nothing but the options.
std::string OptionsObstacle(const ceres::Solver::Options& options);

/// Why there is no memory for the Jacobian of DENSE_QR, asked for or what an empty group of
/// landmarks makes of a Schur solver, or an empty string. Then the problem goes to stock Ceres: QR
/// is never replaced by normal equations.
std::string DenseQrObstacle(const ceres::Solver::Options& options, const ProblemView& view,
                            const OrderingView& ordering,
                            const AvailableMemory& available = AvailableBytes);

/// What these options, or bounds of this problem, ask of a solve in incremental mode that only
/// exact mode has: its reason for being exact, or an empty string. `evaluation_callback` is the
/// problem's, or null. Of a bounded block on a manifold Plus and PlusJacobian are called, once
/// each, to see what they do.
std::string NeedsExactMode(const ceres::Solver::Options& options,
                           const ceres::EvaluationCallback* evaluation_callback);
std::string NeedsExactMode(const ProblemView& view);

/// Asks all questions: why the problem cannot be solved here, or an empty string. `look` reads it
/// into the view, unless the options alone are an obstacle; the ordering is read then too.
/// *exact_reason: why a solve in incremental mode is to be exact, or empty. What calls code of the
/// user's (NeedsExactMode of a view) is asked last, and not of a problem that no mode solves.
std::string FindObstacle(const ceres::Solver::Options& options, bool incremental,
                         const ceres::EvaluationCallback* evaluation_callback,
                         const std::function<void()>& look, const ProblemView& view,
                         OrderingView* ordering, std::string* exact_reason);
/// The same of a problem of which nothing else is asked.
std::string FindObstacle(const ceres::Solver::Options& options, bool incremental,
                         const ceres::EvaluationCallback* evaluation_callback,
                         const ceres::Problem& problem);

}  // namespace inceres::internal
