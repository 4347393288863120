#include "tools/sim/trajectory.h"

#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "inceres/problem/rotation.h"
#include "tools/sim/portable_math.h"

namespace inceres {
namespace {

using Shape = TrajectoryOptions::Shape;

constexpr double kPi = 3.14159265358979323846;

// All shapes, from a rolling and from a standing start, with stops and without.
std::vector<TrajectoryOptions> AllKinds() {
  std::vector<TrajectoryOptions> kinds;
  for (const Shape shape : {Shape::kCircle, Shape::kFigureEight, Shape::kEllipse}) {
    for (const double standing_start : {0.0, 2.5}) {
      for (const double stop_every : {0.0, 3.0}) {
        TrajectoryOptions options;
        options.shape = shape;
        options.standing_start = standing_start;
        options.stop_every = stop_every;
        options.stop_duration = 2.0;
        kinds.push_back(options);
      }
    }
  }
  return kinds;
}

// The rotation vector that takes the orientation of a to that of b, in the frame of a.
std::array<double, 3> Turn(const Motion& a, const Motion& b) {
  double inverse[4], q[4];
  std::array<double, 3> phi{};
  ConjugateQuaternion(a.pose.data() + 3, inverse);
  MultiplyQuaternions(inverse, b.pose.data() + 3, q);
  LogQuaternion(q, phi.data());
  return phi;
}

TEST(Trajectory, DerivativesAgreeWithNumericOnes) {
  constexpr double kStep = 1e-4;
  internal::Random random(5, 0);
  for (const TrajectoryOptions& options : AllKinds()) {
    ASSERT_TRUE(options.Validate().ok());
    for (int i = 0; i < 1000; ++i) {
      const double time = random.Uniform(kStep, 40.0);
      const Motion before = MotionAt(options, time - kStep), now = MotionAt(options, time),
                   after = MotionAt(options, time + kStep);
      const std::array<double, 3> turn = Turn(before, after);
      for (std::size_t k = 0; k < 3; ++k) {
        ASSERT_NEAR((after.pose[k] - before.pose[k]) / (2 * kStep), now.velocity[k], 1e-6) << time;
        ASSERT_NEAR((after.velocity[k] - before.velocity[k]) / (2 * kStep), now.acceleration[k],
                    1e-6)
            << time;
        ASSERT_NEAR(turn[k] / (2 * kStep), now.angular_rate[k], 1e-6) << time;
      }
    }
  }
}

TEST(Trajectory, AccelerationAndAngularRateHaveNoSteps) {
  for (const TrajectoryOptions& options : AllKinds()) {
    Motion last = MotionAt(options, 0.0);
    for (int i = 1; i < 40000; ++i) {
      const Motion now = MotionAt(options, 1e-3 * i);
      for (std::size_t k = 0; k < 3; ++k) {
        ASSERT_NEAR(now.acceleration[k], last.acceleration[k], 0.1) << i;
        ASSERT_NEAR(now.angular_rate[k], last.angular_rate[k], 0.02) << i;
      }
      last = now;
    }
  }
}

TEST(Trajectory, StandingStartStandsAndRollingStartRolls) {
  TrajectoryOptions options;
  EXPECT_NEAR(MotionAt(options, 0.0).velocity[1], 5.0 * 2.0 * kPi / 20.0, 1e-12);
  options.standing_start = 3.0;
  for (const double time : {0.0, 1.0, 3.0}) {
    const Motion motion = MotionAt(options, time);
    EXPECT_EQ(motion.pose, MotionAt(options, 0.0).pose);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(motion.velocity[k], 0.0);
      EXPECT_EQ(motion.acceleration[k], 0.0);
      EXPECT_EQ(motion.angular_rate[k], 0.0);
    }
  }
  const Motion moving = MotionAt(options, 4.5);
  EXPECT_NEAR(std::hypot(moving.velocity[0], moving.velocity[1]), 5.0 * 2.0 * kPi / 20.0, 1e-12);
}

TEST(Trajectory, AtAStopItTurnsOnceOnTheSpot) {
  TrajectoryOptions options;
  options.stop_every = 3.0;
  options.stop_duration = 2.0;
  // Moves for 3 s, slows down for 1 s, stands from 4 to 6 s, speeds up until 7 s, moves until 10 s.
  const Motion arrival = MotionAt(options, 4.0 + 1e-9);
  double turned = 0.0;
  Motion last = arrival;
  for (double time = 4.01; time < 6.0; time += 0.01) {
    const Motion now = MotionAt(options, time);
    for (std::size_t k = 0; k < 3; ++k) {
      ASSERT_EQ(now.pose[k], arrival.pose[k]) << time;
      ASSERT_EQ(now.velocity[k], 0.0);
    }
    const std::array<double, 3> turn = Turn(last, now);
    turned += std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    last = now;
  }
  EXPECT_NEAR(turned, 2.0 * kPi, 1e-3);
  const std::array<double, 3> left = Turn(arrival, MotionAt(options, 6.0));
  EXPECT_NEAR(left[0] * left[0] + left[1] * left[1] + left[2] * left[2], 0.0, 1e-12);
  // 4 s of full speed a round of 7 s.
  TrajectoryOptions without = options;
  without.stop_every = 0.0;
  EXPECT_NEAR(MotionAt(options, 7.0 + 1.5).pose[0], MotionAt(without, 4.0 + 1.5).pose[0], 1e-12);
}

TEST(Trajectory, TheEllipseIsThatOfTheLiterature) {
  TrajectoryOptions options;
  options.shape = Shape::kEllipse;
  options.radius = 15.0;
  options.height = 1.0;
  const double t = 3.3, K = kPi / 10.0;
  const Motion motion = MotionAt(options, t);
  EXPECT_NEAR(motion.pose[0], 15.0 * std::cos(K * t), 1e-12);
  EXPECT_NEAR(motion.pose[1], 20.0 * std::sin(K * t), 1e-12);
  EXPECT_NEAR(motion.pose[2], std::sin(10.0 * K * t), 1e-12);
  // Columns of R_z(yaw) R_y(pitch) R_x(roll): the first one is the direction of the x axis.
  double R[9];
  QuaternionToMatrix(motion.pose.data() + 3, R);
  const double yaw = K * t + kPi / 2.0, pitch = 0.2 * std::sin(t), roll = 0.1 * std::cos(t);
  EXPECT_NEAR(R[0], std::cos(yaw) * std::cos(pitch), 1e-12);
  EXPECT_NEAR(R[3], std::sin(yaw) * std::cos(pitch), 1e-12);
  EXPECT_NEAR(R[6], -std::sin(pitch), 1e-12);
  EXPECT_NEAR(R[7], std::cos(pitch) * std::sin(roll), 1e-12);
}

TEST(Trajectory, FacesWhereItGoes) {
  TrajectoryOptions options;
  options.height = options.roll = options.pitch = 0.0;
  for (const Shape shape : {Shape::kCircle, Shape::kFigureEight}) {
    options.shape = shape;
    for (double time = 0.0; time < 25.0; time += 0.37) {
      const Motion motion = MotionAt(options, time);
      double R[9];
      QuaternionToMatrix(motion.pose.data() + 3, R);
      const double speed = std::hypot(motion.velocity[0], motion.velocity[1]);
      EXPECT_NEAR(R[0] * speed, motion.velocity[0], 1e-12);
      EXPECT_NEAR(R[3] * speed, motion.velocity[1], 1e-12);
    }
  }
}

TEST(Trajectory, NamesAndRanges) {
  Shape shape = Shape::kCircle;
  EXPECT_TRUE(GetTrajectoryShape("ellipse", &shape).ok());
  EXPECT_EQ(shape, Shape::kEllipse);
  EXPECT_EQ(GetTrajectoryShape("square", &shape).message,
            "no trajectory 'square'; known are circle, figure_eight, ellipse");
  EXPECT_EQ(shape, Shape::kEllipse);
  const std::pair<double TrajectoryOptions::*, const char*> fields[] = {
      {&TrajectoryOptions::radius, "radius"},
      {&TrajectoryOptions::height, "height"},
      {&TrajectoryOptions::period, "period"},
      {&TrajectoryOptions::roll, "roll"},
      {&TrajectoryOptions::pitch, "pitch"},
      {&TrajectoryOptions::standing_start, "standing_start"},
      {&TrajectoryOptions::stop_every, "stop_every"},
      {&TrajectoryOptions::stop_duration, "stop_duration"}};
  for (const auto& [field, name] : fields) {
    for (const double value : {-2.0, 1e7, std::nan(""), std::numeric_limits<double>::infinity()}) {
      TrajectoryOptions options;
      options.*field = value;
      const Status status = options.Validate();
      EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
      EXPECT_EQ(status.message.find(std::string("TrajectoryOptions: ") + name + " is "), 0u)
          << status.message;
    }
  }
}

}  // namespace
}  // namespace inceres
