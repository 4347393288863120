// An OKVIS-style estimator on a simulated run: what a user's binary that links Ceres looks like.

#include <ceres/solver.h>

#include "common/run.h"
#include "okvis/okvis_run.h"

int main(int argc, char** argv) {
  using namespace sliding_window;  // NOLINT(google-build-using-namespace)
  RunOptions options;
  OkvisOptions okvis_options;
  const std::string usage =
      R"(okvis_map: a visual-inertial map of keyframes and landmarks in one ceres::Problem that
lives as long as the run, solved after every image by DOGLEG on one thread. The startup scene has
two cameras, whose images show as many features as --features says, and begins with velocity
zero.)";
  const Switch newest_first{
      "--newest_first",
      "before each solve, another of two iterations with all held but the newest frame",
      &okvis_options.newest_first};
  if (const auto exit_code = ParseCommandLine(usage, argc, argv, &options, {newest_first})) {
    return *exit_code;
  }
  const RunReport report =
      RunOkvis(options, okvis_options,
               [](const ceres::Solver::Options& solver, ceres::Problem* problem,
                  ceres::Solver::Summary* summary) { ceres::Solve(solver, problem, summary); });
  return Write(options, report) ? 0 : 1;
}
