#include "common/simulator.h"

#include <cmath>

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double kMinDepth = 1.5, kMaxDepth = 12.0;  // m, of new features
constexpr double kVisibleDepth = 0.5;

// Position and its first two derivatives: rounds of 6 m by 4 m that rise and fall.
struct Path {
  Vector3d p, v, a;
};

Path PathAt(double t) {
  constexpr double w = 0.3;
  const Vector3d size(6.0, 4.0, 0.8);
  const Vector3d rate(w, w, 2.5 * w);
  Path path;
  for (int i = 0; i < 3; ++i) {
    const double phase = rate[i] * t + (i == 0 ? 0.5 * M_PI : 0.0);
    path.p[i] = size[i] * std::sin(phase);
    path.v[i] = size[i] * rate[i] * std::cos(phase);
    path.a[i] = -size[i] * rate[i] * rate[i] * std::sin(phase);
  }
  return path;
}

// Attitude as yaw, pitch, roll (world from body = Rz Ry Rx) and their rates: the yaw turns once a round, the rest sways.
struct Attitude {
  Vector3d ypr, rate;
};

Attitude AttitudeAt(double t) {
  const Vector3d mean_rate(0.3, 0.0, 0.0);
  const Vector3d start(0.5 * M_PI, 0.0, 0.0);
  const Vector3d sway(0.25, 0.12, 0.15);
  const Vector3d sway_rate(1.1, 0.9, 1.3);
  Attitude attitude;
  for (int i = 0; i < 3; ++i) {
    attitude.ypr[i] = start[i] + mean_rate[i] * t + sway[i] * std::sin(sway_rate[i] * t);
    attitude.rate[i] = mean_rate[i] + sway[i] * sway_rate[i] * std::cos(sway_rate[i] * t);
  }
  return attitude;
}

// Angular velocity in body axes from the rates of yaw, pitch and roll.
Vector3d BodyRate(const Attitude& attitude) {
  const double pitch = attitude.ypr[1];
  const double roll = attitude.ypr[2];
  const Vector3d& rate = attitude.rate;
  return {rate[2] - std::sin(pitch) * rate[0], std::cos(roll) * rate[1] + std::sin(roll) * std::cos(pitch) * rate[0],
          -std::sin(roll) * rate[1] + std::cos(roll) * std::cos(pitch) * rate[0]};
}

Eigen::Quaterniond ToQuaternion(const Vector3d& ypr) {
  return Eigen::AngleAxisd(ypr[0], Vector3d::UnitZ()) * Eigen::AngleAxisd(ypr[1], Vector3d::UnitY()) *
         Eigen::AngleAxisd(ypr[2], Vector3d::UnitX());
}

bool InImage(const Vector3d& in_camera) {
  return in_camera.z() > kVisibleDepth &&
         std::abs(in_camera.x() / in_camera.z()) * Simulator::kFocalLength < Simulator::kHalfWidth &&
         std::abs(in_camera.y() / in_camera.z()) * Simulator::kFocalLength < Simulator::kHalfHeight;
}

}  // namespace

Simulator::Simulator(const SimulatorOptions& options) : options_(options), random_(options.seed) {
  ba_ = Noise(0.05);
  bg_ = Noise(0.005);
}

ImuState Simulator::Truth(double time) const {
  const Path path = PathAt(time);
  return {{path.p, ToQuaternion(AttitudeAt(time).ypr)}, path.v, ba_, bg_};
}

Pose Simulator::TrueExtrinsic() {
  Matrix3d R;  // columns: the camera's axes (right, down, ahead) in the body's (ahead, left, up)
  R << 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0;
  return {Vector3d(0.10, 0.02, -0.03), Eigen::Quaterniond(R) * Exp(Vector3d(0.02, -0.03, 0.01))};
}

Frame Simulator::Next() {
  Frame frame;
  if (next_frame_ == 0) {
    last_imu_sample_ = NextImuSample();
  } else {
    frame.imu.push_back(last_imu_sample_);
    for (int i = 0; i < kImuSamplesPerFrame; ++i) {
      frame.imu.push_back(NextImuSample());
    }
    last_imu_sample_ = frame.imu.back();
  }
  frame.time = last_imu_sample_.time;
  ++next_frame_;
  Observe(&frame);
  return frame;
}

ImuSample Simulator::NextImuSample() {
  const ImuNoise& noise = options_.imu_noise;
  const double t = next_imu_sample_++ * kImuPeriod;
  ba_ += Noise(noise.acc_bias_walk * std::sqrt(kImuPeriod));
  bg_ += Noise(noise.gyr_bias_walk * std::sqrt(kImuPeriod));
  const Attitude attitude = AttitudeAt(t);
  const Vector3d specific_force = ToQuaternion(attitude.ypr).conjugate() * (PathAt(t).a + kGravity);
  return {t, specific_force + ba_ + Noise(noise.acc / std::sqrt(kImuPeriod)),
          BodyRate(attitude) + bg_ + Noise(noise.gyr / std::sqrt(kImuPeriod))};
}

void Simulator::Observe(Frame* frame) {
  const Pose world_from_camera = Truth(frame->time).pose * TrueExtrinsic();
  const Pose camera_from_world = world_from_camera.Inverse();
  std::vector<Track> seen;
  for (Track& track : tracks_) {
    if (--track.frames_left > 0 && InImage(camera_from_world * track.point)) {
      seen.push_back(track);
    }
  }
  while (static_cast<int>(seen.size()) < options_.tracks_per_frame) {
    seen.push_back(NewTrack(world_from_camera));
  }
  tracks_ = std::move(seen);
  for (const Track& track : tracks_) {
    const Vector3d noisy =
        camera_from_world * track.point / (camera_from_world * track.point).z() + Noise(options_.pixel_noise / kFocalLength);
    frame->observations.push_back({track.feature, noisy.head<2>()});
  }
}

Simulator::Track Simulator::NewTrack(const Pose& world_from_camera) {
  std::uniform_real_distribution<double> side(-1.0, 1.0);
  std::uniform_real_distribution<double> depth(kMinDepth, kMaxDepth);
  std::uniform_int_distribution<int> length(options_.min_track_length, options_.max_track_length);
  const double x = side(random_) * kHalfWidth / kFocalLength;
  const double y = side(random_) * kHalfHeight / kFocalLength;
  const Vector3d point = world_from_camera * (depth(random_) * Vector3d(x, y, 1.0));
  return {next_feature_++, length(random_), point};
}

Vector3d Simulator::Noise(double standard_deviation) {
  std::normal_distribution<double> normal(0.0, standard_deviation);
  const double x = normal(random_);
  const double y = normal(random_);
  return {x, y, normal(random_)};
}

}  // namespace sliding_window
