// A visual-inertial window from raw samples to a trajectory: reads a sequence
// (docs/visual_inertial.md has the format; vio_simulate writes it) or simulates a preset, estimates
// frame by frame, prints the errors, and writes what plot_vio_window.py draws.
//
//     vio_window cubic | figure_eight | ellipse | FILE [trajectory.csv]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <string>

#include "inceres/estimator/sliding_window_estimator.h"
#include "inceres/estimator/trajectory_error.h"
#include "inceres/io/vio_sequence.h"
#include "tools/sim/vio_scene.h"

namespace {

using inceres::Status;

// What the estimator is told of camera and IMU.
inceres::SlidingWindowOptions OptionsOf(const inceres::VioSequence& sequence) {
  inceres::SlidingWindowOptions options;
  options.body_from_camera = sequence.camera.imu_from_camera;
  options.feature_sigma = {sequence.pixel_noise / sequence.camera.intrinsics[0],
                           sequence.pixel_noise / sequence.camera.intrinsics[1]};
  options.imu.noise = sequence.imu_noise;
  std::copy(sequence.gravity.begin(), sequence.gravity.end(), options.imu.conventions.gravity);
  return options;
}

// The features of a frame, as they would be without distortion.
std::vector<inceres::WindowObservation> ObservationsOf(const inceres::VioSequence& sequence,
                                                       const inceres::VioFrame& frame) {
  std::vector<inceres::WindowObservation> observations;
  for (const inceres::VioObservation& seen : frame.observations) {
    const double pixel[2] = {seen.x, seen.y};
    inceres::WindowObservation observation;
    observation.track = seen.point;
    if (sequence.camera.Pinhole().Unproject(pixel, observation.point.data())) {
      observations.push_back(observation);
    }
  }
  return observations;
}

// The first state is taken from the sequence's start values; their biases are zero, and known to be
// as uncertain as that.
inceres::WindowStart StartOf(const inceres::VioFrame& frame) {
  inceres::WindowStart start;
  start.state = {frame.time, frame.start.pose, frame.start.velocity, frame.start.gyr_bias,
                 frame.start.acc_bias};
  start.gyr_bias_sigma = {0.02, 0.02, 0.02};
  return start;
}

struct Result {
  inceres::Trajectory estimate, truth;
  std::vector<double> times;
  int num_failures = 0;
  double seconds = 0.0;
};

// [quoted in docs/visual_inertial.md]
Status Play(const inceres::VioSequence& sequence, Result* result) {
  inceres::SlidingWindowEstimator window(OptionsOf(sequence));
  const inceres::VioFrame& first = sequence.frames.front();
  if (Status status = window.Start(StartOf(first), ObservationsOf(sequence, first)); !status.ok()) {
    return status;
  }
  inceres::WindowSummary summary;
  for (std::size_t i = 1; i < sequence.frames.size(); ++i) {
    const inceres::VioFrame& frame = sequence.frames[i];
    const auto begin = std::chrono::steady_clock::now();
    window.AddFrame({frame.time, frame.imu, ObservationsOf(sequence, frame)}, &summary);
    result->seconds +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (!summary.status.ok()) {  // no state is lost: say so and go on
      std::cerr << "frame " << i << ": " << summary.status.message << '\n';
      ++result->num_failures;
    }
    result->times.push_back(summary.state.time);
    result->estimate.push_back(summary.state.pose);
    result->truth.push_back(frame.truth.pose);
  }
  return Status::Ok();
}
// [end of quote]

void Print(const Result& result) {
  const inceres::RelativePoseError frame =
      inceres::RelativePoseErrorOverFrames(result.estimate, result.truth, 1);
  const inceres::RelativePoseError meter =
      inceres::RelativePoseErrorOverPath(result.estimate, result.truth, 1.0);
  const auto count = static_cast<double>(result.estimate.size());
  std::printf("frames         %zu, %.3g ms each, %d failed\n", result.estimate.size(),
              1e3 * result.seconds / count, result.num_failures);
  std::printf("ATE            %.4g m\n",
              inceres::AbsoluteTrajectoryError(result.estimate, result.truth));
  std::printf("RPE, 1 frame   %.4g m, %.4g deg\n", frame.translation, frame.rotation_degrees);
  std::printf("RPE, 1 m       %.4g m, %.4g deg, %d pairs\n", meter.translation,
              meter.rotation_degrees, meter.num_pairs);
}

bool Write(const std::string& path, const Result& result) {
  std::ofstream file(path);
  file.precision(9);
  file << "time,x,y,z,true_x,true_y,true_z\n";
  for (std::size_t i = 0; i < result.times.size(); ++i) {
    file << result.times[i];
    for (const auto* pose : {&result.estimate[i], &result.truth[i]}) {
      file << ',' << (*pose)[0] << ',' << (*pose)[1] << ',' << (*pose)[2];
    }
    file << '\n';
  }
  return static_cast<bool>(file.flush());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3 || argv[1][0] == '-') {
    std::cerr << "usage: vio_window cubic | figure_eight | ellipse | FILE [trajectory.csv]\n";
    return 2;
  }
  inceres::VioSceneOptions scene;
  inceres::VioSequence sequence;
  Status status = inceres::GetVioScenePreset(argv[1], &scene).ok()
                      ? inceres::GenerateVioScene(scene, &sequence)
                      : inceres::ReadVioSequence(argv[1], &sequence);
  status = status.ok() && sequence.frames.size() < 4
               ? Status::Error(inceres::StatusCode::kInvalidArgument,
                               std::string(argv[1]) + ": fewer than four frames")
               : status;
  Result result;
  status = status.ok() ? Play(sequence, &result) : status;
  if (!status.ok()) {
    std::cerr << "vio_window: " << status.message << '\n';
    return 1;
  }
  Print(result);
  if (argc == 3 && !Write(argv[2], result)) {
    std::cerr << "vio_window: cannot write " << argv[2] << '\n';
    return 1;
  }
  return result.num_failures == 0 ? 0 : 1;
}
