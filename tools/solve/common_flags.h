#pragma once

#include "inceres/status.h"
#include "tools/problems/loss_spec.h"

namespace inceres::tools {

/// What flags say that all programs have which solve by bundle adjustment: bal_solve, ab_compare,
/// bal_solve_mpi. Nothing of Ceres.
struct CommonSettings {
  double eta = 0.1;  ///< of conjugate gradients
  int max_linear_solver_iterations = 500;
  int num_threads = 1;
  int max_num_iterations = 50;
  double function_tolerance = 1e-6;
  double gradient_tolerance = 1e-10;
  double parameter_tolerance = 1e-8;
  double initial_trust_region_radius = 1e4;
  LossSpec robust;
};

/// Reads --eta, --max_linear_solver_iterations, --num_threads, --max_num_iterations,
/// --function_tolerance, --gradient_tolerance, --parameter_tolerance, --initial_trust_region_radius
/// and --robust. A value that makes no sense is kInvalidArgument; the message names the flag and
/// what it may be.
Status ReadCommonFlags(CommonSettings* settings);

/// What Ceres and the core call by the same names.
template <typename Options>
void CopyNumbers(const CommonSettings& settings, Options* options) {
  options->num_threads = settings.num_threads;
  options->max_num_iterations = settings.max_num_iterations;
  options->function_tolerance = settings.function_tolerance;
  options->gradient_tolerance = settings.gradient_tolerance;
  options->parameter_tolerance = settings.parameter_tolerance;
  options->initial_trust_region_radius = settings.initial_trust_region_radius;
}

}  // namespace inceres::tools
