// inceres/eigen.h: vectors, quaternions, poses and covariances in Eigen's types.
#include "inceres/eigen.h"

#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/solver/solver.h"

namespace inceres {
namespace {

TEST(Eigen, VariablesComeFromAnyExpressionAndAreSeenInPlace) {
  FactorGraph graph;
  Eigen::Matrix3d points;
  points << 1, 2, 3, 4, 5, 6, 7, 8, 9;
  const VariableId row = AddVariable(&graph, points.row(1), Role::kLandmark);
  const VariableId sum = AddVariable(&graph, points.col(0) + points.col(1), Role::kFrame);
  EXPECT_EQ(graph.AmbientSize(row), 3);
  EXPECT_EQ(graph.role(row), Role::kLandmark);
  EXPECT_EQ(ValuesOf(graph, row), Eigen::Vector3d(4, 5, 6));
  EXPECT_EQ(ValuesOf<3>(graph, sum), Eigen::Vector3d(3, 9, 15));
  EXPECT_EQ(ValuesOf(graph, sum).data(), graph.Values(sum));
  SetValues(&graph, row, Eigen::Vector3i(1, 2, 3));
  EXPECT_EQ(ValuesOf<3>(graph, row), Eigen::Vector3d(1, 2, 3));
}

TEST(Eigen, EditsAndSolversTakeThemToo) {
  IncrementalOptions options;
  options.publish_snapshots = true;
  IncrementalSolver solver(options);
  const auto priors = solver.AddFamily(std::make_shared<DiagonalPriorFamily>(2));
  GraphEdit edit(solver.graph());
  const VariableId x = AddVariable(&edit, Eigen::Vector2d(5, 6), Role::kFrame);
  edit.AddFactor(priors, {{1.0, 2.0}, {1.0, 1.0}}, {x});
  ASSERT_TRUE(solver.Apply(edit).ok());
  EXPECT_EQ(ValuesOf<2>(solver, x), Eigen::Vector2d(5, 6));
  solver.Update();
  EXPECT_LT((ValuesOf(solver, x) - Eigen::Vector2d(1, 2)).norm(), 1e-6);
  ValueSnapshot snapshot;
  ASSERT_TRUE(solver.ReadSnapshot(&snapshot));
  EXPECT_EQ(ValuesOf<2>(snapshot, x), ValuesOf<2>(solver, x));
}

TEST(Eigen, QuaternionsKeepTheirOrder) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(0.5, 0.1, -0.2, 0.3).normalized();
  EXPECT_EQ(QuaternionAt(q.coeffs().data()).w(), q.w());
  EXPECT_EQ(QuaternionAtWxyz(WxyzOf(q).data()).coeffs(), q.coeffs());
  EXPECT_EQ(WxyzOf(q)[0], q.w());
}

TEST(Eigen, PosesRoundTrip) {
  FactorGraph graph;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translate(Eigen::Vector3d(1, 2, 3));
  pose.rotate(Eigen::AngleAxisd(2.0, Eigen::Vector3d(1, 1, 0).normalized()));
  const VariableId id = AddPose(&graph, pose);
  EXPECT_EQ(graph.TangentSize(id), 6);
  EXPECT_LT((PoseAt(graph.Values(id)).matrix() - pose.matrix()).norm(), 1e-14);
}

TEST(Eigen, SquareRootsOfInformationAreByRows) {
  Eigen::Matrix2d information;
  information << 4, 1, 1, 9;
  double U[4];
  ASSERT_TRUE(SqrtInformation(information, U));
  const Eigen::Map<const Eigen::Matrix<double, 2, 2, Eigen::RowMajor>> root(U);
  EXPECT_LT((root.transpose() * root - information).norm(), 1e-14);
  EXPECT_EQ(root(1, 0), 0.0);
  EXPECT_FALSE(SqrtInformation(-information, U));
  EXPECT_FALSE(SqrtInformation(Eigen::MatrixXd::Identity(2, 3), U));
}

TEST(Eigen, CovariancesAreMatrices) {
  FactorGraph graph;
  const VariableId a = AddVariable(&graph, Eigen::Vector2d(1, 2), Role::kFrame);
  const VariableId b = AddVariable(&graph, Eigen::Vector3d(1, 2, 3), Role::kFrame);
  const auto two = graph.AddFamily(std::make_shared<DiagonalPriorFamily>(2));
  const auto three = graph.AddFamily(std::make_shared<DiagonalPriorFamily>(3));
  graph.AddFactor(two, {{0.0, 0.0}, {2.0, 4.0}}, {a});
  graph.AddFactor(three, {{0.0, 0.0, 0.0}, {1.0, 1.0, 1.0}}, {b});
  GraphCovariance covariance;
  ASSERT_TRUE(covariance.Compute(graph, {{a, a}, {a, b}}).ok());
  const auto own = CovarianceBlock(covariance, graph, a, a);
  ASSERT_TRUE(own.has_value());
  EXPECT_LT((*own - Eigen::Vector2d(0.25, 0.0625).asDiagonal().toDenseMatrix()).norm(), 1e-12);
  const auto cross = CovarianceBlock(covariance, graph, a, b);
  ASSERT_TRUE(cross.has_value());
  EXPECT_EQ(cross->rows(), 2);
  EXPECT_EQ(cross->cols(), 3);
  EXPECT_FALSE(CovarianceBlock(covariance, graph, b, b).has_value());
  EXPECT_FALSE(CovarianceBlock(covariance, graph, a, 99).has_value());
}

}  // namespace
}  // namespace inceres
