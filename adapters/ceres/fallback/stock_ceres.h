#pragma once

#include <ceres/problem.h>
#include <ceres/solver.h>

namespace inceres::internal {

/// Stock Ceres's solver. The member function is called, not the free ceres::Solve: the free one goes through the member, so
/// whoever replaces the member must never be reached from here by way of the free one.
void SolveWithStock(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary);

}  // namespace inceres::internal
