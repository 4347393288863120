#pragma once

#include <string>
#include <vector>

#include "adapters/test_problems.h"
#include "inceres/ceres/solve.h"

namespace inceres::testing {

/// The same recipe solved by both, each on its own copy.
struct BothSolved {
  std::unique_ptr<TestProblem> stock_problem;
  std::unique_ptr<TestProblem> our_problem;
  ceres::Solver::Summary stock;
  ceres::Solver::Summary ours;
  SolveReport report;
};

/// Changes options that depend on the copy (an ordering, callbacks). May be null.
using Adjust = std::function<void(TestProblem*, ceres::Solver::Options*)>;

/// Each solved with its own evaluation callback, if it has one.
BothSolved SolveBoth(const Recipe& recipe, const ceres::Solver::Options& options,
                     const Adjust& adjust = nullptr);

/// By a session of its own, or by a single solve: what incremental mode is asked for in two ways.
void SolveBySessionOrOnce(bool session, const ceres::Solver::Options& options,
                          ceres::Problem* problem, const SolveOptions& asked,
                          ceres::Solver::Summary* summary, SolveReport* report);

/// Every field of the summaries but times; costs and norms of the trace to a relative tolerance.
/// Elimination order and Schur structure only if `same_elimination`.
void ExpectSameSummary(const BothSolved& both, double tolerance, bool same_elimination);

/// All that is counted in them.
void ExpectSameCounts(const ceres::Solver::Summary& a, const ceres::Solver::Summary& b);

/// Addresses, which differ from copy to copy, by the order in which they appear.
std::string WithoutAddresses(const std::string& text);

/// The parameters both ended with.
void ExpectSameParameters(const BothSolved& both, double tolerance);

}  // namespace inceres::testing
