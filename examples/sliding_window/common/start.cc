#include "common/start.h"

#include <random>

namespace sliding_window {

using Eigen::Vector3d;

namespace {

constexpr double kStartupExtrinsicP = 0.004;  // m, standard deviations in each axis
constexpr double kStartupExtrinsicR = 0.006;  // rad
constexpr double kAlignedTilt = 0.01;         // rad
constexpr double kAlignedSpeed = 0.05;        // m/s

Start HallStart(Start start, bool free_extrinsics) {
  start.state.v += Vector3d(0.05, -0.03, 0.02);
  if (free_extrinsics) {
    for (Pose& extrinsic : start.body_from_cameras) {
      extrinsic =
          extrinsic * Pose{Vector3d(0.01, -0.01, 0.005), Exp(Vector3d(0.008, -0.005, 0.004))};
    }
  }
  return start;
}

// Position and yaw are the true ones, for nothing else could tell them.
Start StartupStart(const RunOptions& options, const Vector3d& specific_force, Start start) {
  std::mt19937_64 random(options.simulator.seed);
  std::normal_distribution<double> normal;
  const auto noise = [&](double sigma) {
    const double x = normal(random);
    const double y = normal(random);
    return Vector3d(sigma * Vector3d(x, y, normal(random)));
  };
  for (Pose& extrinsic : start.body_from_cameras) {
    const Vector3d p = noise(kStartupExtrinsicP);
    const Vector3d r = noise(kStartupExtrinsicR);
    if (options.estimator.free_extrinsics) {
      extrinsic = {extrinsic.p + p, Exp(r) * extrinsic.q};
    }
  }
  Eigen::Quaterniond& q = start.state.pose.q;
  if (options.is_aligned) {
    const Vector3d tilt = noise(kAlignedTilt);
    q = Exp(Vector3d(tilt.x(), tilt.y(), 0.0)) * q;
    start.state.v += noise(kAlignedSpeed);
  } else {  // in the air: velocity zero, up is where the accelerometer points
    q = q * Eigen::Quaterniond::FromTwoVectors(specific_force, q.conjugate() * Vector3d::UnitZ());
    start.state.v.setZero();
  }
  return start;
}

}  // namespace

void SetScene(Scene scene, RunOptions* options) {
  options->scene = scene;
  if (scene == Scene::kHall) {
    return;
  }
  options->num_frames = 50;
  options->num_features = 90;
  SimulatorOptions& simulator = options->simulator;
  simulator.num_cameras = 2;
  simulator.min_depth = 0.5;
  simulator.max_depth = 18.0;
  simulator.max_track_length = 30;
  simulator.outlier_share = 0.004;
  simulator.depth_error = 0.03;
  simulator.acc_bias = 0.03;
  simulator.gyr_bias = 0.004;
  simulator.flight = {20.0, 0.5, 1.0, 2.0};
  EstimatorOptions& estimator = options->estimator;
  estimator.linear_solver = ceres::SPARSE_SCHUR;
  estimator.max_num_iterations = 10;
}

Start MakeStart(const RunOptions& options, const Simulator& simulator) {
  Start start{simulator.Truth(0.0), simulator.TrueExtrinsics()};
  start.state.ba.setZero();
  start.state.bg.setZero();
  return options.scene == Scene::kHall ? HallStart(start, options.estimator.free_extrinsics)
                                       : StartupStart(options, simulator.SpecificForce(0.0), start);
}

}  // namespace sliding_window
