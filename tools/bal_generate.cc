// Writes a BAL problem of a simulated scene: see bal_generate --help.

#include <cstddef>
#include <cstdio>
#include <string>

#include <gflags/gflags.h>
#include <nlohmann/json.hpp>

#include "inceres/io/bal.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/generate/make_scene.h"
#include "tools/generate/scene_flags.h"
#include "tools/sim/simulated_bal.h"

DEFINE_string(
    preset, "",
    "sizes of a well-known problem: ladybug-like (49 cameras, 7776 points, 31843 observations), "
    "venice11 (11, 8366, 20271), cathedral (92, 57957, 422163); and paths with loops: path-400 "
    "(16000, 80000), path-1800 (72000, 360000), path-1000 (40000, 200000), path-10000 "
    "(400000, 2000000). city-N: N cameras in the streets of a city, 20 points each, start values "
    "that drift. collection-N: a collection of N photos, 326 points and up to 2119 observations "
    "each; collection-13682 has 4456117 points and 28987644 observations. Other flags given as "
    "well take precedence");
DEFINE_string(output, "",
              "the file to write: .txt, or compressed as .txt.gz or .txt.bz2 (required)");
DEFINE_string(truth, "",
              "also write the true cameras and points with exact observations, as a BAL file of "
              "the same order");
DEFINE_bool(by_photo, false,
            "write the observations photo by photo, as programs have them that extend a map by "
            "photos, instead of point by point");

namespace {

using inceres::Status;
using inceres::StatusCode;
using inceres::tools::Heartbeat;
using inceres::tools::Invalid;
using inceres::tools::Out;
using inceres::tools::ProgressOutput;
using inceres::tools::WriteJsonReport;

const inceres::tools::ToolHelp kHelp = {
    "Make a bundle-adjustment problem in BAL format from a simulated scene.",
    "Synthetic all of them, whatever known problem has the same counts. A street: a camera on a "
    "path, with local visibility and, if wanted, loops. A city: a drive through its streets, with "
    "loops of all lengths and start values that drift. A collection: photos of sights by many "
    "people, in no order, some points on hundreds of them. Start values are the truth plus noise. "
    "The file can be read by bal_solve, by the bundle adjuster of the Ceres examples, and by any "
    "other program for BAL files.",
    {{"eleven cameras, as many points as Venice has",
      "bal_generate --preset venice11 --output venice11.txt"},
     {"two laps with outliers, and the truth beside them",
      "bal_generate --num_cameras 200 --laps 2 --track_length 5 --outlier_fraction 0.02 --output "
      "loop.txt.bz2 --truth truth.txt.bz2"},
     {"eleven thousand cameras in a city of wide streets",
      "bal_generate --preset city-11000 --street_width 32 --output city.txt"},
     {"photos of a collection; the start values are the truth",
      "bal_generate --preset collection-300 --true_start --output photos.txt"}}};

Status CheckFlags() {
  if (FLAGS_output.empty()) {
    return Invalid("--output FILE is required; see --help");
  }
  return Status::Ok();
}

Status WriteTo(const std::string& path, const inceres::BalProblem& problem) {
  const Heartbeat heartbeat(ProgressOutput(), "writing " + path);
  return inceres::WriteBal(path, problem);
}

Status Report(const inceres::BalProblem& problem, std::size_t num_outliers, double start_rms,
              double true_rms) {
  std::fprintf(Out(),
               "cameras       %d\npoints        %d\nobservations  %zu, of them %zu outliers\n",
               problem.num_cameras, problem.num_points, problem.observations.size(), num_outliers);
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
      {"num_outliers", num_outliers},
      {"initial_rms_pixels", start_rms},
      {"true_rms_pixels", true_rms},
      {"seed", inceres::tools::SceneSeed()}};
  return WriteJsonReport(report);
}

// The truth takes the place of the problem when that is written: one copy in memory.
Status Run() {
  inceres::SimulatedBal scene;
  Status status = CheckFlags();
  status = status.ok() ? inceres::tools::MakeScene(FLAGS_preset, &scene) : status;
  if (status.ok() && FLAGS_by_photo) {
    scene.SortByCamera();
  }
  status = status.ok() ? WriteTo(FLAGS_output, scene.problem) : status;
  if (!status.ok()) {
    return status;
  }
  const double start_rms = inceres::ReprojectionRms(scene.problem);
  const double true_rms = scene.RmsAtTruth();
  if (!FLAGS_truth.empty()) {
    scene.BecomeTruth();
    status = WriteTo(FLAGS_truth, scene.problem);
  }
  return status.ok() ? Report(scene.problem, scene.outliers.size(), start_rms, true_rms) : status;
}

}  // namespace

int main(int argc, char** argv) {
  return inceres::tools::RunTool(kHelp, argc, argv, Run);
}
