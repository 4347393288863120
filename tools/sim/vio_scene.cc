#include "tools/sim/vio_scene.h"

#include <cstddef>
#include <utility>

#include "tools/sim/portable_math.h"
#include "tools/sim/vio_noise.h"
#include "tools/sim/vio_tracks.h"

namespace inceres {
namespace internal {
namespace {

// What an IMU without noise measures on the way, a = Rᵀ(acceleration − g) and the angular rate.
ImuSample ExactSample(const Motion& motion, double time, const Vector3& gravity) {
  const Rotation R{motion.pose[6], {motion.pose[3], motion.pose[4], motion.pose[5]}};
  const Vector3 force = R.Inverse() * (motion.acceleration - gravity);
  ImuSample sample;
  sample.time = time;
  for (std::size_t k = 0; k < 3; ++k) {
    sample.gyr[k] = motion.angular_rate[k];
    sample.acc[k] = force[k];
  }
  return sample;
}

// Frames at their true poses with exact IMU samples.
void MakeFrames(const VioSceneOptions& options, VioSequence* sequence) {
  const double imu_rate = options.frame_rate * options.imu_per_frame;
  for (std::int64_t i = 0; i < options.num_frames; ++i) {
    VioFrame frame;
    const std::int64_t last = i * options.imu_per_frame;
    Motion motion;
    for (std::int64_t k = i > 0 ? last - options.imu_per_frame : 0; k <= last; ++k) {
      const double time = static_cast<double>(k) / imu_rate;
      motion = MotionAt(options.trajectory, time);
      frame.imu.push_back(ExactSample(motion, time, sequence->gravity));
    }
    frame.time = frame.imu.back().time;
    frame.truth.pose = motion.pose;
    frame.truth.velocity = motion.velocity;
    sequence->frames.push_back(std::move(frame));
  }
}

Status MakePoints(const VioSceneOptions& options, VioSequence* sequence) {
  std::vector<VioTrack> tracks;
  if (Status status = VioTracker(options, *sequence).MakeTracks(&tracks); !status.ok()) {
    return status;
  }
  for (const VioTrack& track : tracks) {
    VioObservation observation;
    observation.point = static_cast<int>(sequence->points.size());
    for (const int i : track.frames) {
      VioFrame& frame = sequence->frames[static_cast<std::size_t>(i)];
      sequence->Project(frame.truth.pose, track.point, &observation.x, &observation.y);
      frame.observations.push_back(observation);
    }
    sequence->points.push_back({track.point, track.point});
  }
  return Status::Ok();
}

// Weights must be positive: a noise that is switched off keeps the default.
void SetWeight(double noise, double* weight) {
  *weight = noise > 0.0 ? noise : *weight;
}

}  // namespace
}  // namespace internal

Status GenerateVioScene(const VioSceneOptions& options, VioSequence* sequence) {
  if (Status status = options.Validate(); !status.ok()) {
    return status;
  }
  VioSequence result;
  result.camera = options.camera;
  internal::SetWeight(options.pixel_noise, &result.pixel_noise);
  internal::SetWeight(options.gyr_noise, &result.imu_noise.gyr);
  internal::SetWeight(options.acc_noise, &result.imu_noise.acc);
  internal::SetWeight(options.gyr_bias_walk, &result.imu_noise.gyr_bias_walk);
  internal::SetWeight(options.acc_bias_walk, &result.imu_noise.acc_bias_walk);
  internal::MakeFrames(options, &result);
  if (Status status = internal::MakePoints(options, &result); !status.ok()) {
    return status;
  }
  internal::AddImuNoise(options, &result);
  internal::AddPixelNoise(options, &result);
  internal::MakeStartValues(options, &result);
  *sequence = std::move(result);
  return Status::Ok();
}

}  // namespace inceres
