#include "inceres/estimator/trajectory_error.h"

#include <cmath>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace inceres {
namespace {

std::array<double, 7> Pose(const Eigen::Vector3d& p, const Eigen::Quaterniond& q) {
  return {p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w()};
}

// Steps of 0.4 m along x, turning.
Trajectory Path(const Eigen::Quaterniond& R, const Eigen::Vector3d& t, double extra_step,
                double extra_turn) {
  Trajectory poses;
  for (int i = 0; i < 11; ++i) {
    const Eigen::Quaterniond turn(
        Eigen::AngleAxisd((0.1 + extra_turn) * i, Eigen::Vector3d::UnitZ()));
    poses.push_back(
        Pose(R * Eigen::Vector3d((0.4 + extra_step) * i, std::sin(i), 0.0) + t, R * turn));
  }
  return poses;
}

TEST(TrajectoryError, ARigidMotionOfAllIsNone) {
  const Eigen::Quaterniond R(Eigen::AngleAxisd(2.0, Eigen::Vector3d(1.0, 2.0, -1.0).normalized()));
  const Trajectory truth = Path(Eigen::Quaterniond::Identity(), {0.0, 0.0, 0.0}, 0.0, 0.0);
  const Trajectory moved = Path(R, {5.0, -3.0, 2.0}, 0.0, 0.0);
  EXPECT_LT(AbsoluteTrajectoryError(moved, truth), 1e-14);
  const RelativePoseError error = RelativePoseErrorOverFrames(moved, truth, 1);
  EXPECT_EQ(error.num_pairs, 10);
  EXPECT_LT(error.translation, 1e-14);
  EXPECT_LT(error.rotation_degrees, 1e-5);
}

TEST(TrajectoryError, ScaleIsNotAligned) {
  // Twice the size: what is left after aligning the middles is the distance to the middle.
  const Trajectory truth{
      {-1, 0, 0, 0, 0, 0, 1}, {1, 0, 0, 0, 0, 0, 1}, {0, 1, 0, 0, 0, 0, 1}, {0, -1, 0, 0, 0, 0, 1}};
  Trajectory estimate = truth;
  for (auto& pose : estimate) {
    pose[0] = 2.0 * pose[0] + 7.0;
    pose[1] *= 2.0;
  }
  EXPECT_NEAR(AbsoluteTrajectoryError(estimate, truth), 1.0, 1e-14);
}

TEST(TrajectoryError, RelativeErrorsAreThoseOfTheMotions) {
  const Eigen::Quaterniond I = Eigen::Quaterniond::Identity();
  Trajectory truth, estimate;
  for (int i = 0; i < 11; ++i) {
    truth.push_back(Pose({0.4 * i, 0.0, 0.0}, I));
    estimate.push_back(Pose({0.5 * i, 0.0, 0.0},
                            Eigen::Quaterniond(Eigen::AngleAxisd(0.0, Eigen::Vector3d::UnitX()))));
  }
  EXPECT_NEAR(RelativePoseErrorOverFrames(estimate, truth, 1).translation, 0.1, 1e-14);
  const RelativePoseError three = RelativePoseErrorOverFrames(estimate, truth, 3);
  EXPECT_EQ(three.num_pairs, 3);  // 0, 3, 6, 9
  EXPECT_NEAR(three.translation, 0.3, 1e-14);
  // Along the estimate's path: poses 2, 4, 6, 8, 10.
  const RelativePoseError meter = RelativePoseErrorOverPath(estimate, truth, 0.999);
  EXPECT_EQ(meter.num_pairs, 4);
  EXPECT_NEAR(meter.translation, 0.2, 1e-14);
  const RelativePoseError turning = RelativePoseErrorOverFrames(
      Path(I, {0.0, 0.0, 0.0}, 0.0, 0.01), Path(I, {0.0, 0.0, 0.0}, 0.0, 0.0), 1);
  EXPECT_NEAR(turning.rotation_degrees, 0.01 * 180.0 / M_PI, 1e-12);
  EXPECT_EQ(RelativePoseErrorOverPath(estimate, truth, 100.0).num_pairs, 0);
}

}  // namespace
}  // namespace inceres
