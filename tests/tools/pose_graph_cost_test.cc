#include "tools/problems/pose_graph_cost.h"

#include <cmath>
#include <memory>
#include <vector>

#include <ceres/solver.h>
#include <gtest/gtest.h>

#include "tests/tools/small_problems.h"
#include "tools/problems/pose_graph_ceres_problem.h"

namespace inceres::tools {
namespace {

TEST(Se2BetweenError, VanishesAtTheMeasurementAndWrapsTheAngle) {
  const Eigen::Vector3d measured(1.0, 2.0, 0.5);
  const Se2BetweenError error(measured, Eigen::Matrix3d::Identity());
  const double a[] = {3.0, -1.0, 3.0};
  // Three whole turns away: the same pose.
  const double b[] = {3.0 + std::cos(3.0) - 2.0 * std::sin(3.0),
                      -1.0 + std::sin(3.0) + 2.0 * std::cos(3.0), 3.5 - 6.0 * M_PI};
  double residuals[3];
  error(a, b, residuals);
  for (const double r : residuals) {
    EXPECT_NEAR(r, 0.0, 1e-13);
  }
}

TEST(Se3BetweenError, IsWeightedPositionAndRotationVector) {
  Se3BetweenError::Matrix6d weight = Se3BetweenError::Matrix6d::Identity();
  weight(0, 0) = 2.0;
  weight(5, 5) = 10.0;
  const Se3BetweenError error(Eigen::Vector3d(1.0, 0.0, 0.0), Eigen::Quaterniond::Identity(),
                              weight);
  const Eigen::Quaterniond q_a(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX()));
  const Eigen::Quaterniond q_b =
      q_a * Eigen::Quaterniond(Eigen::AngleAxisd(1e-4, Eigen::Vector3d::UnitZ()));
  const Eigen::Vector3d p_a(4.0, 5.0, 6.0);
  const Eigen::Vector3d p_b = p_a + q_a * Eigen::Vector3d(1.5, 0.25, 0.0);
  Eigen::Matrix<double, 6, 1> r;
  error(p_a.data(), q_a.coeffs().data(), p_b.data(), q_b.coeffs().data(), r.data());
  Eigen::Matrix<double, 6, 1> expected;
  expected << 1.0, 0.25, 0.0, 0.0, 0.0, 1e-3;
  EXPECT_LT((r - expected).norm(), 1e-11);
}

class PoseGraphSolve : public testing::TestWithParam<int> {};

TEST_P(PoseGraphSolve, RecoversTheCircleFromPerfectMeasurements) {
  const PoseGraph graph = SmallPoseGraph(GetParam());
  std::vector<double> poses = graph.poses;
  std::unique_ptr<ceres::Problem> problem;
  const Status status = BuildPoseGraphCeresProblem(graph, LossSpec{}, poses.data(), &problem);
  ASSERT_TRUE(status.ok()) << status.message;
  ceres::Solver::Options options;
  options.function_tolerance = 1e-14;
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem.get(), &summary);
  EXPECT_GT(summary.initial_cost, 1e-3);
  EXPECT_LT(summary.final_cost, 1e-12);
  for (int k = 0; k < graph.PoseSize(); ++k) {
    EXPECT_EQ(poses[static_cast<std::size_t>(k)], graph.poses[static_cast<std::size_t>(k)])
        << "the first pose is constant";
  }
  const double* opposite = poses.data() + 6 * graph.PoseSize();
  EXPECT_NEAR(opposite[0], -5.0, 1e-6);
  EXPECT_NEAR(opposite[1], 0.0, 1e-6);
  const GeometryDifference moved = PoseDifference(graph, poses, graph.poses);
  EXPECT_GT(moved.positions, 1e-4);
  EXPECT_GT(moved.rotations, 1e-4);
  EXPECT_EQ(PoseDifference(graph, poses, poses).positions, 0.0);
}

TEST_P(PoseGraphSolve, AnIndefiniteInformationMatrixIsAnErrorThatNamesTheEdge) {
  PoseGraph graph = SmallPoseGraph(GetParam());
  graph.edges[4].information[0] = -1.0;
  std::unique_ptr<ceres::Problem> problem;
  const Status status = BuildPoseGraphCeresProblem(graph, LossSpec{LossSpec::Kind::kHuber, 1.0},
                                                   graph.poses.data(), &problem);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("edge 4"), std::string::npos) << status.message;
  EXPECT_EQ(problem, nullptr);
}

TEST_P(PoseGraphSolve, EveryEdgeHasTheLoss) {
  PoseGraph graph = SmallPoseGraph(GetParam());
  std::unique_ptr<ceres::Problem> problem;
  ASSERT_TRUE(BuildPoseGraphCeresProblem(graph, LossSpec{LossSpec::Kind::kHuber, 1.0},
                                         graph.poses.data(), &problem)
                  .ok());
  std::vector<ceres::ResidualBlockId> edges;
  problem->GetResidualBlocks(&edges);
  ASSERT_EQ(edges.size(), graph.edges.size());
  for (const ceres::ResidualBlockId edge : edges) {
    EXPECT_NE(problem->GetLossFunctionForResidualBlock(edge), nullptr);
  }
}

TEST_P(PoseGraphSolve, TheFilesFixedPosesAreConstantInsteadOfTheFirst) {
  PoseGraph graph = SmallPoseGraph(GetParam());
  graph.fixed = {3};
  std::unique_ptr<ceres::Problem> problem;
  ASSERT_TRUE(BuildPoseGraphCeresProblem(graph, LossSpec{}, graph.poses.data(), &problem).ok());
  EXPECT_TRUE(problem->IsParameterBlockConstant(graph.PoseData(3)));
  EXPECT_FALSE(problem->IsParameterBlockConstant(graph.PoseData(0)));
}

INSTANTIATE_TEST_SUITE_P(Dimensions, PoseGraphSolve, testing::Values(2, 3));

TEST(BuildPoseGraphCeresProblem, AGraphWithoutEdgesIsAnError) {
  PoseGraph graph = SmallPoseGraph(2);
  graph.edges.clear();
  std::unique_ptr<ceres::Problem> problem;
  EXPECT_EQ(BuildPoseGraphCeresProblem(graph, LossSpec{}, graph.poses.data(), &problem).code,
            StatusCode::kInvalidArgument);
}

TEST(PoseDifference, AnglesOneTurnApartAreTheSame) {
  const PoseGraph graph = SmallPoseGraph(2);
  std::vector<double> turned = graph.poses;
  turned[5] += 2.0 * M_PI;
  EXPECT_NEAR(PoseDifference(graph, turned, graph.poses).rotations, 0.0, 1e-14);
}

}  // namespace
}  // namespace inceres::tools
