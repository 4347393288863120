// The code of docs/autodiff.md.

#include <cmath>
#include <memory>
#include <vector>

#include <ceres/problem.h>
#include <ceres/rotation.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include "inceres/autodiff/autodiff_family.h"
#include "inceres/autodiff/numeric_diff_family.h"
#include "inceres/ceres/autodiff_cost_function.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/solver.h"

namespace {

// A camera [angle-axis, t] of focal length 1 that looks along z.
struct ViewError {
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    for (int k = 0; k < 3; ++k) {
      p[k] += camera[3 + k];
    }
    residuals[0] = p[0] / p[2] - x;
    residuals[1] = p[1] / p[2] - y;
    return true;
  }
  double x, y;
};

TEST(AutoDiffPage, TheNamespaceIsSwapped) {
  double camera[6] = {0.1, 0.0, 0.0, 0.0, 0.0, 0.0};
  double point[3] = {0.5, 0.2, 4.0};
  const double x = 0.1, y = 0.05;
  ceres::Problem problem;
  // [quoted in docs/autodiff.md]
  using Cost = inceres::AutoDiffCostFunction<ViewError, 2, 6, 3>;  // was ceres::
  problem.AddResidualBlock(new Cost(new ViewError{x, y}), nullptr, camera, point);
  // [end of quote]
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  EXPECT_LT(summary.final_cost, 1e-12);
}

// [quoted in docs/autodiff.md]
struct Decay {  // y = a exp(−b t)
  template <typename T>
  bool operator()(const T* ab, T* residual) const {
    using std::exp;  // for doubles; that of Jets is found by itself
    residual[0] = ab[0] * exp(-ab[1] * t) - y;
    return true;
  }
  double t, y;
};
// [end of quote]

TEST(AutoDiffPage, AFamilyOfTheCore) {
  // [quoted in docs/autodiff.md]
  inceres::FactorGraph graph;
  const auto samples =
      graph.AddFamily(std::make_shared<inceres::AutoDiffFamily<Decay, 1, 2>>("sample"));
  const double start[2] = {1.0, 1.0};
  const auto ab = graph.AddVariable(start, 2, inceres::Role::kFrame);
  for (int i = 0; i < 20; ++i) {
    graph.AddFactor(samples, {0.1 * i, 3.0 * std::exp(-0.2 * i)}, {ab});
  }
  const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
  // [end of quote]
  EXPECT_TRUE(summary.IsSolutionUsable());
  EXPECT_NEAR(graph.Values(ab)[0], 3.0, 1e-6);
  EXPECT_NEAR(graph.Values(ab)[1], 2.0, 1e-6);
}

}  // namespace
