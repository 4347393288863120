// Monte Carlo consistency of the visual-inertial window: normalized error squared of the newest
// pose over time, with first-estimate Jacobians and without, and with the first view of a landmark
// taken as exact. `--help` says how.

#include "estimator/window_consistency.h"

#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include <gflags/gflags.h>
#include <nlohmann/json.hpp>

#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"

DEFINE_int32(runs, 100, "simulated windows, seed by seed");
DEFINE_int32(frames, 100, "camera frames of each, ten a second");
DEFINE_int32(stride, 2, "takes the error at each so many frames");
DEFINE_int32(size, 10, "frames of the window");
DEFINE_string(rule, "okvis",
              "what happens to landmarks of the oldest frame that the newest one sees: okvis (they "
              "stay) or vins");

namespace {

using inceres::LandmarkForm;
using inceres::SlidingWindowOptions;
using inceres::Status;
using inceres::StatusCode;
using inceres::WindowRule;
using inceres::test::PoseNees;

const inceres::tools::ToolHelp kHelp = {
    "Play simulated windows and compare the errors of the newest pose with its covariance.",
    "The mean over the runs is 6 for an estimator whose covariances are right. Exit code 1 as well "
    "if, over all times, the mean with first-estimate Jacobians on is not in the 95 % band of one "
    "time. docs/make_window_pictures.py draws what --json writes.",
    {{"a hundred windows of ten seconds",
      "window_consistency --runs 100 --frames 100 --json consistency.json"}}};

struct Variant {
  const char* name;
  const char* key;
  bool first_estimates;
  LandmarkForm form;
};
constexpr Variant kVariants[] = {
    {"first-estimate Jacobians", "with", true, LandmarkForm::kBearing},
    {"without", "without", false, LandmarkForm::kBearing},
    {"without, first view exact", "exact", false, LandmarkForm::kInverseDepth}};

nlohmann::json ToJson(const std::vector<PoseNees>& results) {
  nlohmann::json report = {
      {"runs", FLAGS_runs}, {"frames", FLAGS_frames},         {"size", FLAGS_size},
      {"rule", FLAGS_rule}, {"band", results.front().Band()}, {"times", results.front().times}};
  for (std::size_t k = 0; k < results.size(); ++k) {
    report[kVariants[k].key] = {
        {"name", kVariants[k].name}, {"rms", results[k].rms_error}, {"nees", results[k].means}};
  }
  return report;
}

Status Run() {
  if (FLAGS_runs < 1 || FLAGS_stride < 1 || FLAGS_frames <= FLAGS_stride) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "--runs and --stride must be positive, --frames more than --stride");
  }
  if (FLAGS_rule != "okvis" && FLAGS_rule != "vins") {
    return Status::Error(StatusCode::kInvalidArgument,
                         "--rule is okvis or vins, not '" + FLAGS_rule + "'");
  }
  SlidingWindowOptions window;
  window.size = FLAGS_size;
  if (Status status = window.Validate(); !status.ok()) {
    return status;
  }
  std::vector<PoseNees> results;
  for (const Variant& variant : kVariants) {
    const inceres::tools::Heartbeat heartbeat(inceres::tools::ProgressOutput(), variant.name);
    results.push_back(inceres::test::MonteCarloNees(
        inceres::test::ConsistencyScene(FLAGS_frames), FLAGS_runs, FLAGS_stride,
        [&](SlidingWindowOptions* options) {
          options->size = FLAGS_size;
          options->rule = FLAGS_rule == "okvis" ? WindowRule::kKeepSeenLandmarks
                                                : WindowRule::kMarginalizeLandmarks;
          options->landmark_form = variant.form;
          options->marginalization.first_estimate_jacobians = variant.first_estimates;
        }));
    const PoseNees& nees = results.back();
    std::fprintf(
        inceres::tools::Out(),
        "%-28s mean %.3f of 6, in the band 6 +- %.3f at %.0f %% of the times; RMS error %.4g m\n",
        variant.name, nees.Mean(), nees.Band(), 100.0 * nees.ShareInBand(), nees.rms_error);
  }
  if (Status status = inceres::tools::WriteJsonReport(ToJson(results)); !status.ok()) {
    return status;
  }
  const double mean = results.front().Mean();
  return std::fabs(mean - 6.0) <= results.front().Band()
             ? Status::Ok()
             : Status::Error(StatusCode::kUnavailable,
                             "the mean with first-estimate Jacobians is outside the band");
}

}  // namespace

int main(int argc, char** argv) {
  return inceres::tools::RunTool(kHelp, argc, argv, Run);
}
