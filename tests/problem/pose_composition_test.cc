// Laws of composition, against homogeneous matrices of Eigen.
#include <random>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "inceres/problem/rotation.h"

namespace inceres {
namespace {

Eigen::Matrix3d PlanarMatrix(const double* pose) {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  matrix.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(pose[2]).toRotationMatrix();
  matrix.topRightCorner<2, 1>() = Eigen::Map<const Eigen::Vector2d>(pose);
  return matrix;
}

Eigen::Matrix4d SpatialMatrix(const double* pose) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = Eigen::Map<const Eigen::Quaterniond>(pose + 3).toRotationMatrix();
  matrix.topRightCorner<3, 1>() = Eigen::Map<const Eigen::Vector3d>(pose);
  return matrix;
}

class PoseComposition : public ::testing::Test {
 protected:
  void RandomPlanar(double* pose) {
    for (int k = 0; k < 3; ++k) {
      pose[k] = 4.0 * uniform_(random_);
    }
  }
  void RandomSpatial(double* pose) {
    Eigen::Map<Eigen::Vector4d> q(pose + 3);
    for (int k = 0; k < 7; ++k) {
      pose[k] = uniform_(random_);
    }
    q.normalize();
  }

  std::mt19937 random_{5};
  std::uniform_real_distribution<double> uniform_{-1.0, 1.0};
};

TEST_F(PoseComposition, PlanarIsTheProductOfMatrices) {
  for (int i = 0; i < 1000; ++i) {
    double a[3], b[3], c[3], inverse[3];
    RandomPlanar(a);
    RandomPlanar(b);
    ComposePlanarPoses(a, b, c);
    InvertPlanarPose(a, inverse);
    EXPECT_LT((PlanarMatrix(c) - PlanarMatrix(a) * PlanarMatrix(b)).norm(), 1e-14);
    EXPECT_LT((PlanarMatrix(inverse) * PlanarMatrix(a) - Eigen::Matrix3d::Identity()).norm(),
              1e-14);
    EXPECT_EQ(c[2], a[2] + b[2]);
  }
}

TEST_F(PoseComposition, SpatialIsTheProductOfMatrices) {
  for (int i = 0; i < 1000; ++i) {
    double a[7], b[7], c[7], inverse[7], y[3];
    RandomSpatial(a);
    RandomSpatial(b);
    ComposePoses(a, b, c);
    InvertPose(a, inverse);
    EXPECT_LT((SpatialMatrix(c) - SpatialMatrix(a) * SpatialMatrix(b)).norm(), 1e-14);
    EXPECT_LT((SpatialMatrix(inverse) * SpatialMatrix(a) - Eigen::Matrix4d::Identity()).norm(),
              1e-14);
    TransformPoint(a, b, y);
    EXPECT_LT((SpatialMatrix(c).topRightCorner<3, 1>() - Eigen::Map<Eigen::Vector3d>(y)).norm(),
              1e-14);
  }
}

TEST_F(PoseComposition, AChainStaysOnThePoses) {
  double step[7], pose[7] = {0, 0, 0, 0, 0, 0, 1}, next[7];
  RandomSpatial(step);
  for (int i = 0; i < 100000; ++i) {
    ComposePoses(pose, step, next);
    std::copy(next, next + 7, pose);
  }
  EXPECT_NEAR(Eigen::Map<const Eigen::Vector4d>(pose + 3).norm(), 1.0, 1e-15);
}

}  // namespace
}  // namespace inceres
