// A curve fitted again and again by a program that knows only Ceres: 53 residual blocks of one
// parameter block of three, the problem made anew for each solve. For who counts what a small solve
// takes with the drop-in preloaded (user_share.py).
//
//   build/bin/curve_fits [SOLVES]      101 unless told

#include <cstdio>
#include <cstdlib>

#include <ceres/ceres.h>

#include "curve_samples.h"

namespace {

using inceres::benchmarks::OneSample;

ceres::Solver::Summary Fit() {
  double p[3] = {1.8, 0.31, 0.4};
  ceres::Problem problem;
  for (int i = 0; i < inceres::benchmarks::kNumSamples; ++i) {
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<OneSample, 1, 3>(
                                 new OneSample(inceres::benchmarks::Sample(i))),
                             nullptr, p);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary;
}

}  // namespace

int main(int argc, char** argv) {
  const int num_solves = argc > 1 ? std::atoi(argv[1]) : 101;
  if (num_solves < 1 || argc > 2) {
    std::fprintf(stderr, "usage: curve_fits [SOLVES]: SOLVES is a positive number\n");
    return 2;
  }
  for (int solve = 1; solve < num_solves; ++solve) {
    Fit();
  }
  const ceres::Solver::Summary summary = Fit();
  std::printf("{\"final_cost\": %.12g, \"iterations\": %zu, \"usable\": %s}\n", summary.final_cost,
              summary.iterations.size(), summary.IsSolutionUsable() ? "true" : "false");
  return summary.IsSolutionUsable() ? 0 : 1;
}
