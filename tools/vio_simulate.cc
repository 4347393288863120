// Writes a simulated visual-inertial sequence: see vio_simulate --help.

#include <cmath>
#include <cstdio>
#include <string>

#include <gflags/gflags.h>
#include <nlohmann/json.hpp>

#include "inceres/io/vio_sequence.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/sim/vio_scene.h"

DEFINE_string(output, "", "the file to write: any name, or compressed as .gz or .bz2 (required)");
DEFINE_string(preset, "",
              "cubic (50 frames, 163 points, 789 observations), figure_eight (with loops), ellipse "
              "(with turns on the spot); flags "
              "given as well take precedence");
DEFINE_string(trajectory, "circle",
              "circle, figure_eight or ellipse (horizontal, with a vertical sine)");
DEFINE_double(radius, 5.0, "size of the trajectory, meters");
DEFINE_double(height, 0.5, "amplitude of its vertical sine, meters");
DEFINE_double(period, 20.0, "seconds of movement for a round");
DEFINE_double(standing_start, 0.0,
              "seconds at rest before it moves; 0: it moves from the first moment on");
DEFINE_double(
    stop_every, 0.0,
    "seconds at full speed between stops, at which it turns once on the spot; 0: no stops");
DEFINE_double(stop_duration, 4.0, "seconds of a stop");
DEFINE_int32(frames, 100, "camera frames, 2 to 1000000");
DEFINE_double(frame_rate, 10.0, "frames a second");
DEFINE_int32(imu_per_frame, 20, "IMU samples from one frame to the next");
DEFINE_int32(points, 500, "exact number of points");
DEFINE_int32(observations, 0, "exact number of observations; 0: all that is seen");
DEFINE_int32(max_track_length, 1000, "how often a point is seen at most");
DEFINE_double(max_depth, 12.0, "points are seen up to this far away, meters");
DEFINE_double(loop_fraction, 0.3,
              "share of the points that are recognized when they come into view again, 0 to 1");
DEFINE_double(dropout, 0.0, "share of the sightings in which a feature is not detected, 0 to 0.95");
DEFINE_double(pixel_noise, 1.0, "standard deviation of the observations, pixels");
DEFINE_double(outlier_fraction, 0.0, "share of the observations that are wrong, 0 to 1");
DEFINE_double(outlier_pixels, 50.0, "how far outliers are displaced at most, in x and in y");
DEFINE_double(gyr_noise, 1.7e-4, "density of the white noise, rad/s/sqrt(Hz)");
DEFINE_double(acc_noise, 2e-3, "density of the white noise, m/s^2/sqrt(Hz)");
DEFINE_double(gyr_bias_walk, 2e-5, "density of the walk of the bias, rad/s^2/sqrt(Hz)");
DEFINE_double(acc_bias_walk, 3e-3, "density of the walk of the bias, m/s^3/sqrt(Hz)");
DEFINE_double(initial_gyr_bias, 0.01, "standard deviation of the first bias, rad/s");
DEFINE_double(initial_acc_bias, 0.05, "standard deviation of the first bias, m/s^2");
DEFINE_double(position_drift, 0.05, "how far start values drift from the truth, meters");
DEFINE_double(rotation_drift, 0.005, "how far start values drift from the truth, radians");
DEFINE_double(point_noise, 0.1, "standard deviation of the start values of the points, meters");
DEFINE_uint64(seed, 1, "the same seed and flags give the same file on every machine");

namespace {

using inceres::Status;
using inceres::StatusCode;
using inceres::tools::Heartbeat;
using inceres::tools::Out;
using inceres::tools::ProgressOutput;
using inceres::tools::WriteJsonReport;

const inceres::tools::ToolHelp kHelp = {
    "Simulate a camera with an IMU along a smooth trajectory and write the sequence.",
    "IMU samples, observations of points, start values and the truth behind them. The format is "
    "explained in the file and in docs/visual_inertial.md.",
    {{"fifty frames, ready to solve", "vio_simulate --preset cubic --output cubic.vio"},
     {"a figure of eight with outliers",
      "vio_simulate --trajectory figure_eight --frames 400 --points 1000 --outlier_fraction 0.02 "
      "--output eight.vio.gz"}}};

// A flag sets its option if there is no preset, or if it was given.
template <typename Flag, typename Option>
void Set(const char* name, const Flag& flag, Option* option) {
  if (FLAGS_preset.empty() || !gflags::GetCommandLineFlagInfoOrDie(name).is_default) {
    *option = flag;
  }
}

void SetTrajectory(inceres::TrajectoryOptions* trajectory) {
  Set("radius", FLAGS_radius, &trajectory->radius);
  Set("height", FLAGS_height, &trajectory->height);
  Set("period", FLAGS_period, &trajectory->period);
  Set("standing_start", FLAGS_standing_start, &trajectory->standing_start);
  Set("stop_every", FLAGS_stop_every, &trajectory->stop_every);
  Set("stop_duration", FLAGS_stop_duration, &trajectory->stop_duration);
}

void SetScene(inceres::VioSceneOptions* options) {
  Set("frames", FLAGS_frames, &options->num_frames);
  Set("frame_rate", FLAGS_frame_rate, &options->frame_rate);
  Set("imu_per_frame", FLAGS_imu_per_frame, &options->imu_per_frame);
  Set("points", FLAGS_points, &options->num_points);
  Set("observations", FLAGS_observations, &options->num_observations);
  Set("max_track_length", FLAGS_max_track_length, &options->max_track_length);
  Set("max_depth", FLAGS_max_depth, &options->max_depth);
  Set("loop_fraction", FLAGS_loop_fraction, &options->loop_fraction);
  Set("dropout", FLAGS_dropout, &options->dropout);
  Set("seed", FLAGS_seed, &options->seed);
}

void SetNoise(inceres::VioSceneOptions* options) {
  Set("pixel_noise", FLAGS_pixel_noise, &options->pixel_noise);
  Set("outlier_fraction", FLAGS_outlier_fraction, &options->outlier_fraction);
  Set("outlier_pixels", FLAGS_outlier_pixels, &options->outlier_pixels);
  Set("gyr_noise", FLAGS_gyr_noise, &options->gyr_noise);
  Set("acc_noise", FLAGS_acc_noise, &options->acc_noise);
  Set("gyr_bias_walk", FLAGS_gyr_bias_walk, &options->gyr_bias_walk);
  Set("acc_bias_walk", FLAGS_acc_bias_walk, &options->acc_bias_walk);
  Set("initial_gyr_bias", FLAGS_initial_gyr_bias, &options->initial_gyr_bias);
  Set("initial_acc_bias", FLAGS_initial_acc_bias, &options->initial_acc_bias);
  Set("position_drift", FLAGS_position_drift, &options->position_drift);
  Set("rotation_drift", FLAGS_rotation_drift, &options->rotation_drift);
  Set("point_noise", FLAGS_point_noise, &options->point_noise);
}

Status OptionsFromFlags(inceres::VioSceneOptions* options) {
  if (!FLAGS_preset.empty()) {
    if (Status status = inceres::GetVioScenePreset(FLAGS_preset, options); !status.ok()) {
      return status;
    }
  }
  inceres::TrajectoryOptions::Shape shape{};
  if (Status status = inceres::GetTrajectoryShape(FLAGS_trajectory, &shape); !status.ok()) {
    return status;
  }
  Set("trajectory", shape, &options->trajectory.shape);
  SetTrajectory(&options->trajectory);
  SetScene(options);
  SetNoise(options);
  return Status::Ok();
}

// Root mean square of the distances between observations and projections, at the truth or at the
// start values. What is behind the camera, which start values may bring about, is left out.
double ReprojectionRms(const inceres::VioSequence& sequence, bool truth) {
  double sum = 0.0;
  int count = 0;
  for (const inceres::VioFrame& frame : sequence.frames) {
    for (const inceres::VioObservation& observation : frame.observations) {
      const inceres::VioPoint& point = sequence.points[static_cast<std::size_t>(observation.point)];
      double x = 0.0, y = 0.0;
      if (sequence.Project((truth ? frame.truth : frame.start).pose,
                           truth ? point.truth : point.start, &x, &y)) {
        sum +=
            (x - observation.x) * (x - observation.x) + (y - observation.y) * (y - observation.y);
        ++count;
      }
    }
  }
  return count > 0 ? std::sqrt(sum / count) : 0.0;
}

Status Report(const inceres::VioSequence& sequence, int imu_per_frame) {
  const std::size_t num_frames = sequence.frames.size();
  const double start_rms = ReprojectionRms(sequence, false);
  const double true_rms = ReprojectionRms(sequence, true);
  std::fprintf(Out(), "frames        %zu, %.6g s\nIMU factors   %zu, of %d samples each\n",
               num_frames, sequence.frames.back().time, num_frames - 1, imu_per_frame + 1);
  std::fprintf(Out(), "points        %zu\nobservations  %d, of them %d outliers\n",
               sequence.points.size(), sequence.NumObservations(), sequence.NumOutliers());
  std::fprintf(Out(), "RMS error     %.6g px at the start values, %.6g px at the truth\n",
               start_rms, true_rms);
  std::fprintf(Out(), "wrote         %s\n", FLAGS_output.c_str());
  if (std::fflush(Out()) != 0) {
    return Status::Error(StatusCode::kIo, "cannot print the summary");
  }
  const nlohmann::json report = {{"output", FLAGS_output},
                                 {"num_frames", num_frames},
                                 {"seconds", sequence.frames.back().time},
                                 {"num_imu_factors", num_frames - 1},
                                 {"num_points", sequence.points.size()},
                                 {"num_observations", sequence.NumObservations()},
                                 {"num_outliers", sequence.NumOutliers()},
                                 {"initial_rms_pixels", start_rms},
                                 {"true_rms_pixels", true_rms},
                                 {"seed", FLAGS_seed}};
  return WriteJsonReport(report);
}

Status Run() {
  if (FLAGS_output.empty()) {
    return inceres::tools::Invalid("--output FILE is required; see --help");
  }
  inceres::VioSceneOptions options;
  inceres::VioSequence sequence;
  Status status = OptionsFromFlags(&options);
  if (status.ok()) {
    const Heartbeat heartbeat(ProgressOutput(), "simulating");
    status = inceres::GenerateVioScene(options, &sequence);
  }
  if (status.ok()) {
    const Heartbeat heartbeat(ProgressOutput(), "writing " + FLAGS_output);
    status = inceres::WriteVioSequence(FLAGS_output, sequence);
  }
  return status.ok() ? Report(sequence, options.imu_per_frame) : status;
}

}  // namespace

int main(int argc, char** argv) {
  return inceres::tools::RunTool(kHelp, argc, argv, Run);
}
