#pragma once

#include <functional>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "common/imu_preintegration.h"

namespace sliding_window {

/// What solves: ceres::Solve, or whatever has its signature.
using SolveFunction =
    std::function<void(const ceres::Solver::Options&, ceres::Problem*, ceres::Solver::Summary*)>;

enum class Ordering {
  kAuto,            ///< Ceres chooses what is eliminated
  kLandmarksFirst,  ///< landmarks are eliminated, all else is not
};

struct EstimatorOptions {
  bool free_extrinsics = false;  // estimate where the camera sits on the body
  // cost functions that cost what those of estimators in the field do
  bool realistic_costs = false;
  Ordering ordering = Ordering::kAuto;
  ceres::LinearSolverType linear_solver = ceres::DENSE_SCHUR;
  int max_num_iterations = 8;
  double max_solver_time = 1e9;  // s; the default lets every run have the same result
  ImuNoise imu_noise;
  double pixel_noise = 1.5;  // standard deviation that a measurement is weighted with, pixels
  double focal_length = 460.0;
};

inline ceres::Solver::Options MakeSolverOptions(const EstimatorOptions& options) {
  ceres::Solver::Options solver;
  solver.linear_solver_type = options.linear_solver;
  solver.trust_region_strategy_type = ceres::DOGLEG;
  solver.max_num_iterations = options.max_num_iterations;
  solver.max_solver_time_in_seconds = options.max_solver_time;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  return solver;
}

}  // namespace sliding_window
