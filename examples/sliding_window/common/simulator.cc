#include "common/simulator.h"

#include <cmath>

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double kVisibleDepth = 0.5;
constexpr double kBaseline = 0.11;  // m, between the two cameras

// Position and its first two derivatives: rounds that rise and fall.
struct Path {
  Vector3d p, v, a;
};

Path PathAt(const Flight& flight, double t) {
  const double w = flight.round_rate;
  const Vector3d size = flight.size * Vector3d(6.0, 4.0, 0.8);
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

// Attitude as yaw, pitch, roll (world from body = Rz Ry Rx) and their rates: the yaw turns once a
// round, the rest sways.
struct Attitude {
  Vector3d ypr, rate;
};

Attitude AttitudeAt(const Flight& flight, double t) {
  const Vector3d mean_rate(0.3, 0.0, 0.0);
  const Vector3d start(0.5 * M_PI, 0.0, 0.0);
  const Vector3d sway = flight.sway * Vector3d(0.25, 0.12, 0.15);
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
  return {rate[2] - std::sin(pitch) * rate[0],
          std::cos(roll) * rate[1] + std::sin(roll) * std::cos(pitch) * rate[0],
          -std::sin(roll) * rate[1] + std::cos(roll) * std::cos(pitch) * rate[0]};
}

Eigen::Quaterniond ToQuaternion(const Vector3d& ypr) {
  return Eigen::AngleAxisd(ypr[0], Vector3d::UnitZ()) *
         Eigen::AngleAxisd(ypr[1], Vector3d::UnitY()) *
         Eigen::AngleAxisd(ypr[2], Vector3d::UnitX());
}

bool InImage(const Vector3d& in_camera) {
  return in_camera.z() > kVisibleDepth &&
         std::abs(in_camera.x() / in_camera.z()) * Simulator::kFocalLength <
             Simulator::kHalfWidth &&
         std::abs(in_camera.y() / in_camera.z()) * Simulator::kFocalLength < Simulator::kHalfHeight;
}

}  // namespace

Simulator::Simulator(const SimulatorOptions& options) : options_(options), random_(options.seed) {
  if (options.flight.latest_start > 0.0) {
    start_ = std::uniform_real_distribution<double>(0.0, options.flight.latest_start)(random_);
  }
  ba_ = Noise(options.acc_bias);
  bg_ = Noise(options.gyr_bias);
}

ImuState Simulator::Truth(double time) const {
  const Path path = PathAt(options_.flight, start_ + time);
  return {{path.p, ToQuaternion(AttitudeAt(options_.flight, start_ + time).ypr)}, path.v, ba_, bg_};
}

Vector3d Simulator::SpecificForce(double time) const {
  const Vector3d acceleration = PathAt(options_.flight, start_ + time).a;
  return Truth(time).pose.q.conjugate() * (acceleration + kGravity) + ba_;
}

std::vector<Pose> Simulator::TrueExtrinsics() const {
  Matrix3d R;  // columns: the camera's axes (right, down, ahead) in the body's (ahead, left, up)
  R << 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0;
  const Pose left{Vector3d(0.10, 0.02, -0.03),
                  Eigen::Quaterniond(R) * Exp(Vector3d(0.02, -0.03, 0.01))};
  const Pose right{Vector3d(kBaseline, 0.001, -0.002), Exp(Vector3d(-0.004, 0.006, 0.003))};
  return options_.num_cameras == 1 ? std::vector<Pose>{left}
                                   : std::vector<Pose>{left, left * right};
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
  return {t, SpecificForce(t) + Noise(noise.acc / std::sqrt(kImuPeriod)),
          BodyRate(AttitudeAt(options_.flight, start_ + t)) + bg_ +
              Noise(noise.gyr / std::sqrt(kImuPeriod))};
}

void Simulator::Observe(Frame* frame) {
  std::vector<Pose> camera_from_world;
  for (const Pose& extrinsic : TrueExtrinsics()) {
    camera_from_world.push_back((Truth(frame->time).pose * extrinsic).Inverse());
  }
  const Pose world_from_camera = camera_from_world[0].Inverse();
  std::vector<Track> seen;
  for (Track& track : tracks_) {
    if (--track.frames_left > 0 && InImage(camera_from_world[0] * track.point)) {
      seen.push_back(track);
    }
  }
  while (static_cast<int>(seen.size()) < options_.tracks_per_frame) {
    seen.push_back(NewTrack(world_from_camera));
  }
  tracks_ = std::move(seen);
  for (const Track& track : tracks_) {
    for (int camera = 0; camera < options_.num_cameras; ++camera) {
      ObserveTrack(track, camera, camera_from_world[camera], frame);
    }
  }
}

void Simulator::ObserveTrack(const Track& track, int camera, const Pose& camera_from_world,
                             Frame* frame) {
  const Vector3d in_camera = camera_from_world * track.point;
  if (!InImage(in_camera)) {
    return;
  }
  const Vector3d noisy = in_camera / in_camera.z() + PixelNoise();
  frame->observations.push_back({track.feature, noisy.head<2>(), camera});
  if (options_.depth_error > 0.0) {
    std::normal_distribution<double> error(1.0, options_.depth_error);
    frame->observations.back().depth = in_camera.z() * error(random_);
  }
}

Vector3d Simulator::PixelNoise() {
  const Vector3d noise = Noise(options_.pixel_noise / kFocalLength);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  return options_.outlier_share > 0.0 && share(random_) < options_.outlier_share
             ? kOutlierFactor * noise
             : noise;
}

Simulator::Track Simulator::NewTrack(const Pose& world_from_camera) {
  std::uniform_real_distribution<double> side(-1.0, 1.0);
  std::uniform_real_distribution<double> depth(options_.min_depth, options_.max_depth);
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
