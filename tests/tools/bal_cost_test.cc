#include "tools/problems/bal_cost.h"

#include <cmath>
#include <memory>
#include <vector>

#include <ceres/solver.h>
#include <gtest/gtest.h>

#include "tests/tools/small_problems.h"
#include "tools/problems/bal_ceres_problem.h"

namespace inceres::tools {
namespace {

ceres::Solver::Summary SolveBal(const BalProblem& bal, BalCameraModel model,
                                const char* loss_text = "none") {
  LossSpec loss;
  EXPECT_TRUE(ParseLoss(loss_text, &loss).ok());
  std::vector<double> cameras = CamerasIn(bal, model);
  std::vector<double> points = bal.points;
  const auto problem = BuildBalCeresProblem(bal, loss, cameras.data(), points.data(), model);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = PointsFirstOrdering(bal, cameras.data(), points.data(), model);
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem.get(), &summary);
  return summary;
}

TEST(BalReprojectionError, ProjectsAKnownPoint) {
  // Camera turned by 90 degrees about z, point straight ahead but for (0.1, 0.2) at depth 2, f =
  // 100, k1 = 1, k2 = 2.
  const double camera[] = {0.0, 0.0, M_PI / 2, 0.0, 0.0, -2.0, 100.0, 1.0, 2.0};
  const double point[] = {0.2, -0.1, 0.0};  // turned: (0.1, 0.2, 0)
  double residuals[2];
  BalReprojectionError{{1.0, 2.0}}(camera, point, residuals);
  const double r2 = 0.05 * 0.05 + 0.1 * 0.1;
  const double scale = 100.0 * (1.0 + r2 + 2.0 * r2 * r2);
  EXPECT_NEAR(residuals[0], scale * 0.05 - 1.0, 1e-12);
  EXPECT_NEAR(residuals[1], scale * 0.1 - 2.0, 1e-12);
}

TEST(BalCeresProblem, QuaternionAndAngleAxisCamerasHaveTheSameCostAndSolution) {
  const BalProblem bal = SmallBal();
  const auto angle_axis = SolveBal(bal, BalCameraModel::kAngleAxis);
  const auto quaternion = SolveBal(bal, BalCameraModel::kQuaternion);
  EXPECT_NEAR(angle_axis.initial_cost, quaternion.initial_cost, 1e-10 * angle_axis.initial_cost);
  EXPECT_LT(angle_axis.final_cost, 1e-6 * angle_axis.initial_cost);
  EXPECT_LT(quaternion.final_cost, 1e-6 * quaternion.initial_cost);
  EXPECT_EQ(quaternion.num_effective_parameters, angle_axis.num_effective_parameters);
  EXPECT_EQ(quaternion.num_parameters, angle_axis.num_parameters + bal.num_cameras);
}

TEST(BalCeresProblem, LossLowersTheCostOfLargeResiduals) {
  const BalProblem bal = SmallBal();
  const double plain = SolveBal(bal, BalCameraModel::kAngleAxis).initial_cost;
  const double huber = SolveBal(bal, BalCameraModel::kAngleAxis, "huber:0.1").initial_cost;
  const double cauchy = SolveBal(bal, BalCameraModel::kAngleAxis, "cauchy:0.1").initial_cost;
  EXPECT_LT(huber, 0.9 * plain);
  EXPECT_LT(cauchy, huber);
}

TEST(BalCeresProblem, UnobservedBlocksAreLeftOut) {
  BalProblem bal = SmallBal();
  bal.num_points += 1;
  bal.points.insert(bal.points.end(), 3, 0.0);
  const auto summary = SolveBal(bal, BalCameraModel::kQuaternion);
  EXPECT_EQ(summary.num_parameter_blocks, bal.num_cameras + bal.num_points - 1);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
}

TEST(RmsReprojectionError, MatchesTheCost) {
  const BalProblem bal = SmallBal();
  const double cost = SolveBal(bal, BalCameraModel::kAngleAxis).initial_cost;
  const double num_observations = static_cast<double>(bal.observations.size());
  EXPECT_NEAR(RmsReprojectionError(bal), std::sqrt(2.0 * cost / num_observations), 1e-12);
}

TEST(GeometryOf, CenterIsWhatTheCameraMapsToItsOrigin) {
  const BalProblem bal = SmallBal();
  const SceneGeometry scene = GeometryOf(bal);
  ASSERT_EQ(scene.centers.size(), 4U);
  ASSERT_EQ(scene.points.size(), 30U);
  for (int i = 0; i < bal.num_cameras; ++i) {
    Eigen::Vector3d P;
    ceres::AngleAxisRotatePoint(bal.CameraData(i),
                                scene.centers[static_cast<std::size_t>(i)].data(), P.data());
    EXPECT_LT((P + Eigen::Map<const Eigen::Vector3d>(bal.CameraData(i) + 3)).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace inceres::tools
