// Writes a BAL problem of a simulated street: see bal_generate --help.

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <utility>

#include <gflags/gflags.h>
#include <nlohmann/json.hpp>

#include "inceres/io/bal.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/sim/street_scene.h"

DEFINE_string(output, "",
              "the file to write: .txt, or compressed as .txt.gz or .txt.bz2 (required)");
DEFINE_string(truth, "",
              "also write the true cameras and points with exact observations, as a BAL file of "
              "the same order");
DEFINE_string(
    preset, "",
    "sizes of a well-known problem: ladybug-like (49 cameras, 7776 points, 31843 observations), "
    "venice11 (11, 8366, 20271), cathedral (92, 57957, 422163); and paths with loops: path-400 "
    "(16000, 80000), path-1800 (72000, 360000), path-1000 (40000, 200000), path-10000 "
    "(400000, 2000000). Other flags given as well take precedence");
DEFINE_int32(num_cameras, 100, "cameras along the path, 2 to 1000000");
DEFINE_double(points_per_camera, 100.0,
              "number of points = this times num_cameras, unless num_points is given");
DEFINE_double(track_length, 4.0,
              "mean number of cameras that see a point, at least 2; number of observations = this "
              "times the number "
              "of points, unless num_observations is given");
DEFINE_int32(num_points, 0, "exact number of points (0: see points_per_camera)");
DEFINE_int32(num_observations, 0, "exact number of observations (0: see track_length)");
DEFINE_double(laps, 0.0,
              "rounds of a closed circuit; 0: an open street, 1: the end meets the start, 2.5: "
              "every place is passed two "
              "or three times");
DEFINE_double(loop_fraction, 0.3,
              "share of the points that are recognized when the camera comes by again, 0 to 1");
DEFINE_double(camera_spacing, 0.0,
              "meters between consecutive cameras; 0: what the track length needs");
DEFINE_double(pixel_noise, 0.5, "standard deviation of the observations, pixels");
DEFINE_double(rotation_noise, 0.01, "of the start values of the camera orientations, radians");
DEFINE_double(position_noise, 0.1, "of the start values of the camera centers, meters");
DEFINE_double(focal_noise, 0.01, "of the start values of the focal lengths, relative");
DEFINE_double(distortion_noise, 0.002, "of the start values of k1 and k2");
DEFINE_double(point_noise, 0.1, "of the start values of the points, meters");
DEFINE_double(outlier_fraction, 0.0, "share of the observations that are wrong, 0 to 1");
DEFINE_double(outlier_pixels, 50.0, "how far outliers are displaced at most, in x and in y");
DEFINE_uint64(seed, 1, "the same seed and flags give the same file on every machine");

namespace {

using inceres::Status;
using inceres::StatusCode;
using inceres::tools::Heartbeat;
using inceres::tools::Invalid;
using inceres::tools::IsSet;
using inceres::tools::Out;
using inceres::tools::ProgressOutput;
using inceres::tools::WriteJsonReport;

const inceres::tools::ToolHelp kHelp = {
    "Make a bundle-adjustment problem in BAL format from a simulated street.",
    "A camera on a path through a street of points, with local visibility and, if wanted, loops. "
    "The counts come out exactly; start values are the truth plus noise. The file can be read by "
    "bal_solve, by the bundle adjuster of the Ceres examples, and by any other program for BAL "
    "files.",
    {{"eleven cameras, as many points as Venice has",
      "bal_generate --preset venice11 --output venice11.txt"},
     {"two laps with outliers, and the truth beside them",
      "bal_generate --num_cameras 200 --laps 2 --track_length 5 --outlier_fraction 0.02 --output "
      "loop.txt.bz2 --truth truth.txt.bz2"}}};

Status ToCount(const char* what, double value, int* count) {
  if (!(value >= 0.0 && value <= 2147483646.0)) {
    return Status::Error(StatusCode::kInvalidArgument,
                         std::string(what) + " would be " + std::to_string(value));
  }
  *count = static_cast<int>(std::lround(value));
  return Status::Ok();
}

// Sizes: from the preset, then from what was given on the command line; derived ones follow.
Status SetSizes(inceres::StreetSceneOptions* options) {
  const bool preset = !FLAGS_preset.empty();
  if (preset) {
    if (Status status = inceres::GetStreetScenePreset(FLAGS_preset, options); !status.ok()) {
      return status;
    }
  }
  if (!preset || IsSet("num_cameras")) {
    options->num_cameras = FLAGS_num_cameras;
  }
  if (IsSet("num_points")) {
    options->num_points = FLAGS_num_points;
  } else if (!preset || IsSet("points_per_camera")) {
    if (Status status =
            ToCount("the number of points", FLAGS_points_per_camera * options->num_cameras,
                    &options->num_points);
        !status.ok()) {
      return status;
    }
  }
  if (IsSet("num_observations")) {
    options->num_observations = FLAGS_num_observations;
  } else if (!preset || IsSet("track_length")) {
    return ToCount("the number of observations", FLAGS_track_length * options->num_points,
                   &options->num_observations);
  }
  return Status::Ok();
}

Status OptionsFromFlags(inceres::StreetSceneOptions* options) {
  if (Status status = SetSizes(options); !status.ok()) {
    return status;
  }
  if (FLAGS_preset.empty() || IsSet("laps")) {
    options->laps = FLAGS_laps;
  }
  if (FLAGS_preset.empty() || IsSet("loop_fraction")) {
    options->loop_fraction = FLAGS_loop_fraction;
  }
  options->camera_spacing = FLAGS_camera_spacing;
  options->pixel_noise = FLAGS_pixel_noise;
  options->rotation_noise = FLAGS_rotation_noise;
  options->position_noise = FLAGS_position_noise;
  options->focal_noise = FLAGS_focal_noise;
  options->distortion_noise = FLAGS_distortion_noise;
  options->point_noise = FLAGS_point_noise;
  options->outlier_fraction = FLAGS_outlier_fraction;
  options->outlier_pixels = FLAGS_outlier_pixels;
  options->seed = FLAGS_seed;
  return Status::Ok();
}

Status CheckFlags() {
  if (FLAGS_output.empty()) {
    return Invalid("--output FILE is required; see --help");
  }
  if (FLAGS_output == FLAGS_truth) {
    return Invalid("--output and --truth name the same file");
  }
  for (const auto& [exact, relative] : {std::pair("num_points", "points_per_camera"),
                                        std::pair("num_observations", "track_length")}) {
    if (IsSet(exact) && IsSet(relative)) {
      return Invalid(std::string("--") + exact + " and --" + relative +
                     " both say the same; give one");
    }
  }
  return Status::Ok();
}

Status Generate(inceres::StreetScene* scene) {
  inceres::StreetSceneOptions options;
  if (Status status = OptionsFromFlags(&options); !status.ok()) {
    return status;
  }
  const Heartbeat heartbeat(ProgressOutput(), "simulating");
  return inceres::GenerateStreetScene(options, scene);
}

Status Write(const inceres::StreetScene& scene) {
  const Heartbeat heartbeat(ProgressOutput(), "writing " + FLAGS_output);
  const Status status = inceres::WriteBal(FLAGS_output, scene.problem);
  return status.ok() && !FLAGS_truth.empty() ? inceres::WriteBal(FLAGS_truth, scene.truth) : status;
}

Status Report(const inceres::StreetScene& scene) {
  const inceres::BalProblem& problem = scene.problem;
  inceres::BalProblem at_truth = scene.truth;
  at_truth.observations = problem.observations;
  const double start_rms = inceres::ReprojectionRms(problem);
  const double true_rms = inceres::ReprojectionRms(at_truth);
  std::fprintf(
      Out(), "cameras       %d\npoints        %d\nobservations  %zu, of them %zu outliers\n",
      problem.num_cameras, problem.num_points, problem.observations.size(), scene.outliers.size());
  std::fprintf(Out(), "RMS error     %.6g px at the start values, %.6g px at the truth\n",
               start_rms, true_rms);
  std::fprintf(Out(), "wrote         %s\n", FLAGS_output.c_str());
  if (!FLAGS_truth.empty()) {
    std::fprintf(Out(), "truth         %s\n", FLAGS_truth.c_str());
  }
  if (std::fflush(Out()) != 0) {
    return Status::Error(StatusCode::kIo, "cannot print the summary");
  }
  const nlohmann::json report = {
      {"output", FLAGS_output},
      {"truth", FLAGS_truth.empty() ? nlohmann::json() : nlohmann::json(FLAGS_truth)},
      {"num_cameras", problem.num_cameras},
      {"num_points", problem.num_points},
      {"num_observations", problem.observations.size()},
      {"num_outliers", scene.outliers.size()},
      {"initial_rms_pixels", start_rms},
      {"true_rms_pixels", true_rms},
      {"seed", FLAGS_seed}};
  return WriteJsonReport(report.dump(2));
}

Status Run() {
  inceres::StreetScene scene;
  Status status = CheckFlags();
  status = status.ok() ? Generate(&scene) : status;
  status = status.ok() ? Write(scene) : status;
  return status.ok() ? Report(scene) : status;
}

}  // namespace

int main(int argc, char** argv) {
  return inceres::tools::RunTool(kHelp, argc, argv, Run);
}
