// The example of docs/from_ceres.md, compiled and run as it stands there.

#include <cmath>
#include <memory>
#include <vector>

#include <ceres/autodiff_cost_function.h>
#include <gtest/gtest.h>

#include "inceres/ceres/cost_family.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/solver.h"

namespace {

struct RangeError {
  double range;
  template <typename T>
  bool operator()(const T* pose, const T* X, T* residual) const {
    const T d[3] = {X[0] - pose[0], X[1] - pose[1], X[2] - pose[2]};
    using std::sqrt;
    residual[0] = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) - range;
    return true;
  }
};

TEST(MigrationExamples, ACostFunctionStandsInAGraph) {
  const double pose_values[7] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  const double beacon_values[3] = {4.0, 0.0, 0.0};
  inceres::FactorGraph graph;
  // clang-format off
// [quoted in docs/from_ceres.md]
const auto ranges = graph.AddFamily(std::make_shared<inceres::CeresCostFamily>(
    1, std::vector<inceres::FactorFamily::Slot>{{7, 6}, {3, 3}}));  // residuals; ambient, tangent
const auto manifold = std::make_shared<inceres::PoseManifold>();
const auto pose = graph.AddVariable(pose_values, 7, inceres::Role::kFrame, manifold);
const auto beacon = graph.AddVariable(beacon_values, 3, inceres::Role::kLandmark);
auto cost = std::make_shared<ceres::AutoDiffCostFunction<RangeError, 1, 7, 3>>(new RangeError{5.0});
graph.AddFactor(ranges, cost, {pose, beacon});
// [end of quote]
  // clang-format on
  const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
  EXPECT_EQ(summary.termination, inceres::Termination::kConvergence) << summary.message;
  EXPECT_NEAR(graph.Values(beacon)[0] - graph.Values(pose)[0], 5.0, 1e-6);
}

}  // namespace
