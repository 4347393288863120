// Solves a pose graph in g2o format, with or without wrong loops in it.

#include <cstdio>
#include <string>

#include <gflags/gflags.h>
#include <glog/logging.h>
#include <nlohmann/json.hpp>

#include "inceres/io/g2o.h"
#include "src/base/text.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/command_line/read_flags.h"
#include "tools/command_line/text_file.h"
#include "tools/draw/pose_graph_picture.h"
#include "tools/pose_graph/pose_graph_report.h"
#include "tools/pose_graph/pose_graph_run.h"

DEFINE_string(input, "", "The g2o file to solve: text, .gz or .bz2. Required.");
DEFINE_string(
    initialize, "file",
    "Where poses begin: file (its vertices; along the odometry if it has none), "
    "spanning_tree (along the odometry) or chordal (rotation averaging, then positions).");
DEFINE_string(convention, "geodesic",
              "What the file's information is about: geodesic, ceres, g2o or gtsam. Files of g2o "
              "mean g2o: rotations half as long as elsewhere.");
DEFINE_bool(project_information, false,
            "Take information matrices that are not positive definite for the nearest that are, "
            "instead of refusing the file.");
DEFINE_bool(gnc, false,
            "Find wrong edges by graduated non-convexity, and solve without them. Odometry is "
            "known to be right, unless --suspects all.");
DEFINE_string(suspects, "loops", "With --gnc: which edges may be wrong, loops or all.");
DEFINE_string(kernel, "truncated_least_squares",
              "With --gnc: truncated_least_squares or geman_mcclure.");
DEFINE_string(gnc_start, "chordal",
              "With --gnc: where each weighted problem begins, chordal or previous (where the one "
              "before ended).");
DEFINE_double(
    inlier_probability, 0.99,
    "With --gnc or --outliers: an inlier's squared error is below the chi-square quantile "
    "at this probability. Between 0 and 1.");
DEFINE_double(threshold_scale, 1.0, "Times that quantile; above 0.");
DEFINE_bool(estimate_scale, false,
            "With --gnc: lower the thresholds to what the errors of the right loops say, where the "
            "file's information promises larger ones.");
DEFINE_double(outliers, 0.0,
              "Add wrong loops, so many that they are this share of all loops: two poses at "
              "random, with the measurement of a right loop. At least 0, below 1.");
DEFINE_int32(seed, 1, "Seed of the wrong loops, at least 0.");
DEFINE_bool(certificate, false,
            "Also bound the chordal cost with isotropic noise from below (SE-Sync's dual). It is a "
            "statement about that cost, not about the one that is minimized. Where there is no "
            "bound the exit code is 1, after the report.");
DEFINE_string(trust_region, "dogleg", "Trust-region strategy: lm or dogleg.");
DEFINE_int32(num_threads, 1, "Threads of the solver, at least 1.");
DEFINE_int32(max_num_iterations, 100, "Stop after this many iterations, at least 0.");
DEFINE_double(function_tolerance, 1e-6,
              "Stop when the cost changes by less than this, relative; 0: never.");
DEFINE_string(output, "",
              "Write the solved poses: as a TUM trajectory if the name ends in .tum or .txt, else "
              "as a g2o file without the edges that were found to be wrong.");
DEFINE_string(picture, "",
              "Show before and after in this file: NAME.html with a table of figures, any other "
              "name an SVG picture.");

namespace inceres::tools {
namespace {

using internal::EndsWith;

const ToolHelp kHelp = {
    "Solve a pose graph in g2o format, and tell which of its loops are wrong.",
    "Planar and spatial graphs. The first pose is held where the file holds none. A solve that "
    "--max_num_iterations stopped is a success.",
    {{"a table, and a picture of before and after",
      "pose_graph_solve --input M3500.g2o --picture M3500.svg"},
     {"from the edges alone, in the convention of g2o",
      "pose_graph_solve --input sphere.g2o --initialize chordal --convention g2o"},
     {"three wrong loops among ten, and how many of them are found",
      "pose_graph_solve --input M3500.g2o --gnc --outliers 0.3 --seed 7 --json report.json"},
     {"the trajectory for other tools",
      "pose_graph_solve --input sphere.g2o --gnc --output trajectory.tum"}}};

Status ReadChoices(PoseGraphPlan* plan) {
  for (const Status& status :
       {Choose("--initialize", FLAGS_initialize,
               {{"file", PoseGraphStart::kFile},
                {"spanning_tree", PoseGraphStart::kSpanningTree},
                {"chordal", PoseGraphStart::kChordal}},
               &plan->start),
        Choose("--convention", FLAGS_convention,
               {{"geodesic", PoseErrorConvention::kGeodesic},
                {"ceres", PoseErrorConvention::kCeres},
                {"g2o", PoseErrorConvention::kG2o},
                {"gtsam", PoseErrorConvention::kGtsam}},
               &plan->graph.convention),
        Choose("--kernel", FLAGS_kernel,
               {{"truncated_least_squares", GncKernel::kTruncatedLeastSquares},
                {"geman_mcclure", GncKernel::kGemanMcClure}},
               &plan->gnc_options.kernel),
        Choose("--trust_region", FLAGS_trust_region,
               {{"lm", TrustRegionStrategyKind::kLevenbergMarquardt},
                {"dogleg", TrustRegionStrategyKind::kDogleg}},
               &plan->solver.strategy),
        Choose("--suspects", FLAGS_suspects, {{"loops", false}, {"all", true}}, &plan->suspect_all),
        Choose("--gnc_start", FLAGS_gnc_start, {{"previous", false}, {"chordal", true}},
               &plan->chordal_rounds)}) {
    if (!status.ok()) {
      return status;
    }
  }
  return Status::Ok();
}

Status CheckGncFlags() {
  for (const char* flag : {"suspects", "kernel", "gnc_start", "estimate_scale"}) {
    if (!FLAGS_gnc && IsSet(flag)) {
      return Invalid(std::string("--") + flag + " is for --gnc");
    }
  }
  if (!(FLAGS_outliers >= 0.0 && FLAGS_outliers < 1.0)) {
    return Invalid("--outliers must be at least 0 and below 1");
  }
  if (FLAGS_certificate && !HasChordalBound()) {
    return Invalid("--certificate: this build was configured without Spectra (libspectra-dev)");
  }
  return CheckNumbers({{"--num_threads", FLAGS_num_threads, 1},
                       {"--max_num_iterations", FLAGS_max_num_iterations, 0},
                       {"--seed", FLAGS_seed, 0}},
                      {{"--function_tolerance", FLAGS_function_tolerance}});
}

Status ReadPlan(PoseGraphPlan* plan) {
  if (FLAGS_input.empty()) {
    return Invalid("--input FILE is required; see --help");
  }
  Status status = CheckGncFlags();
  status = status.ok() ? ReadChoices(plan) : status;
  if (!status.ok()) {
    return status;
  }
  plan->solver.num_threads = FLAGS_num_threads;
  plan->solver.max_num_iterations = FLAGS_max_num_iterations;
  plan->solver.function_tolerance = FLAGS_function_tolerance;
  plan->graph.indefinite =
      FLAGS_project_information ? IndefiniteInformation::kProject : IndefiniteInformation::kRefuse;
  plan->gnc = FLAGS_gnc;
  plan->gnc_options.inlier_probability = FLAGS_inlier_probability;
  plan->gnc_options.threshold_scale = FLAGS_threshold_scale;
  plan->gnc_options.estimate_scale = FLAGS_estimate_scale;
  plan->outliers = FLAGS_outliers;
  plan->seed = static_cast<std::uint64_t>(FLAGS_seed);
  plan->certificate = FLAGS_certificate;
  return plan->gnc_options.Validate();
}

Status WriteOutput(const PoseGraphRun& run) {
  if (FLAGS_output.empty()) {
    return Status::Ok();
  }
  if (EndsWith(FLAGS_output, ".tum") || EndsWith(FLAGS_output, ".txt")) {
    return WriteTumTrajectory(FLAGS_output, run.after);
  }
  return WriteG2o(FLAGS_output, WithoutOutliers(run));
}

Status WritePicture(const PoseGraphRun& run) {
  if (FLAGS_picture.empty()) {
    return Status::Ok();
  }
  const std::string title = FLAGS_input.substr(FLAGS_input.rfind('/') + 1) + ": " + Describe(run);
  const std::string svg = PoseGraphPictureSvg(title, run.before, run.after, run.is_outlier);
  return WriteTextFile(FLAGS_picture, EndsWith(FLAGS_picture, ".html")
                                          ? PoseGraphPageHtml(title, svg, Figures(run))
                                          : svg);
}

Status Main() {
  PoseGraphPlan plan;
  Status status = ReadPlan(&plan);
  if (!status.ok()) {
    return Invalid(status.message);
  }
  PoseGraph graph;
  status = ReadG2o(FLAGS_input, &graph, ReadOptionsFromFlags());
  PoseGraphRun run;
  if (status.ok()) {
    const Heartbeat heartbeat(ProgressOutput(), "solving");
    status = RunPoseGraph(plan, graph, &run);
  }
  if (!status.ok()) {  // of the file, not of a flag
    return Status::Error(StatusCode::kIo, status.message);
  }
  for (const auto& [name, text] : Figures(run)) {
    std::fprintf(Out(), "%-26s %s\n", name.c_str(), text.c_str());
  }
  status = WriteOutput(run);
  status =
      status.ok() && WantsJson() ? WriteJsonReport(PoseGraphJson(FLAGS_input, plan, run)) : status;
  status = status.ok() ? WritePicture(run) : status;
  return status.ok() && !run.bound_failure.empty()
             ? Status::Error(StatusCode::kSingular, "--certificate: " + run.bound_failure)
             : status;
}

}  // namespace
}  // namespace inceres::tools

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  FLAGS_logtostderr = true;
  return inceres::tools::RunTool(inceres::tools::kHelp, argc, argv, inceres::tools::Main);
}
