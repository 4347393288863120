#include "tools/solve/common_flags.h"

#include <cmath>
#include <string>

#include <gflags/gflags.h>

#include "tools/command_line/command_line.h"

DEFINE_int32(num_threads, 1, "Threads of the solver, at least 1.");
DEFINE_int32(max_num_iterations, 50, "Stop after this many iterations, at least 0.");
DEFINE_double(function_tolerance, 1e-6,
              "Stop when the cost changes by less than this, relative; 0: never.");
DEFINE_double(gradient_tolerance, 1e-10, "Stop when no entry of the gradient is larger; 0: never.");
DEFINE_double(parameter_tolerance, 1e-8,
              "Stop when the step is shorter than this, relative to the parameters; 0: never.");
DEFINE_double(initial_trust_region_radius, 1e4,
              "First trust-region radius; the damping of lm starts at its reciprocal. Above 0.");
DEFINE_double(eta, 0.1,
              "Conjugate gradients stop when iteration k gains less than this over k of what the "
              "step promises. At least 0.");
DEFINE_int32(max_linear_solver_iterations, 500, "Conjugate gradients a step at most, at least 1.");
DEFINE_string(robust, "none",
              "Robust loss: none, huber:A or cauchy:A, with the scale A in the units of the "
              "residual (BAL: pixels).");

namespace inceres::tools {
namespace {

Status CheckRadius() {
  const double radius = FLAGS_initial_trust_region_radius;
  return std::isfinite(radius) && radius > 0.0
             ? Status::Ok()
             : Invalid("--initial_trust_region_radius " + std::to_string(radius) +
                       ": must be a finite number above 0");
}

}  // namespace

Status ReadCommonFlags(CommonSettings* settings) {
  Status robust = ParseLoss(FLAGS_robust, &settings->robust);
  if (!robust.ok()) {
    robust.message = "--robust " + robust.message;
  }
  for (const Status& status :
       {CheckNumbers({{"--max_linear_solver_iterations", FLAGS_max_linear_solver_iterations, 1},
                      {"--num_threads", FLAGS_num_threads, 1},
                      {"--max_num_iterations", FLAGS_max_num_iterations, 0}},
                     {{"--eta", FLAGS_eta},
                      {"--function_tolerance", FLAGS_function_tolerance},
                      {"--gradient_tolerance", FLAGS_gradient_tolerance},
                      {"--parameter_tolerance", FLAGS_parameter_tolerance}}),
        CheckRadius(), robust}) {
    if (!status.ok()) {
      return status;
    }
  }
  settings->eta = FLAGS_eta;
  settings->max_linear_solver_iterations = FLAGS_max_linear_solver_iterations;
  settings->num_threads = FLAGS_num_threads;
  settings->max_num_iterations = FLAGS_max_num_iterations;
  settings->function_tolerance = FLAGS_function_tolerance;
  settings->gradient_tolerance = FLAGS_gradient_tolerance;
  settings->parameter_tolerance = FLAGS_parameter_tolerance;
  settings->initial_trust_region_radius = FLAGS_initial_trust_region_radius;
  return Status::Ok();
}

}  // namespace inceres::tools
