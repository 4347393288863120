// A VINS-style estimator on a simulated run: what a user's binary that links Ceres looks like.

#include <ceres/solver.h>

#include "common/run.h"
#include "vins/vins_run.h"

int main(int argc, char** argv) {
  using namespace sliding_window;  // NOLINT(google-build-using-namespace)
  RunOptions options;
  const std::string usage =
      R"(vins_window: a visual-inertial window of eleven frames, rebuilt as a new ceres::Problem
for every image, and solved by DOGLEG on one thread. There is one camera, whose images show half as
many features as --features says; the startup scene begins where an alignment of images and IMU
ends.)";
  if (const auto exit_code = ParseCommandLine(usage, argc, argv, &options)) {
    return *exit_code;
  }
  const RunReport report = RunVins(
      options, [](const ceres::Solver::Options& solver, ceres::Problem* problem,
                  ceres::Solver::Summary* summary) { ceres::Solve(solver, problem, summary); });
  return Write(options, report) ? 0 : 1;
}
