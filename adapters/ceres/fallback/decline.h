#pragma once

#include <string>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "inceres/ceres/solve.h"

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

}  // namespace inceres::internal
