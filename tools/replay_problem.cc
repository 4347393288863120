#include "tools/replay_problem.h"

#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <string>

#include <gflags/gflags.h>

#include "inceres/io/bal.h"
#include "inceres/io/g2o.h"
#include "inceres/io/keyframes.h"
#include "inceres/io/stereo_odometry.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/output.h"
#include "tools/command_line/read_flags.h"
#include "tools/command_line/read_progress.h"
#include "tools/pose_graph/pose_graph_run.h"
#include "tools/replay/replay_ceres_solve.h"
#include "tools/replay/replay_scripts.h"
#include "tools/replay/vio_source.h"

DEFINE_string(problem, "",
              "bal:FILE, kf:FILE, stereo:FOLDER, g2o:FILE, vio:FILE, vio:PRESET (cubic, "
              "figure_eight, ellipse), or path:N for N "
              "cameras along a generated path. Required.");
DEFINE_bool(free_intrinsics, false,
            "bal and path only: free the intrinsics; without it they are held.");
DEFINE_bool(no_priors, false, "bal and path only: leave out the priors on new cameras and points.");
DEFINE_bool(
    presolve, true,
    "bal only: solve the whole file first and start new cameras and points near the solution.");
DEFINE_bool(
    loops, false,
    "path only: the path comes back to a place seen before once a lap and sees old points again.");
DEFINE_int32(
    seed, 1,
    "bal, path, and g2o with --outliers: seed of the noise on start values, of the path, or "
    "of the wrong loops; at least 0.");
DEFINE_double(outliers, 0.0,
              "g2o only: add wrong loops, so many that they are this share of all loops, from the "
              "same pairs as pose_graph_solve does. At least 0, below 1.");
DEFINE_int32(num_threads, 1, "Threads of each solver, at least 1.");
DEFINE_int32(max_num_iterations, 50, "Iterations a solve at most, at least 1.");
DEFINE_double(function_tolerance, 1e-6,
              "Stop a solve when the cost changes by less than this, relative; 0: never.");
DEFINE_double(gradient_tolerance, 1e-10,
              "Of Ceres, and of inceres in exact mode: stop when no entry of the gradient is "
              "larger; 0: never.");
DEFINE_double(parameter_tolerance, 0.0,
              "As --gradient_tolerance: stop when the step is shorter than this, relative to the "
              "parameters; 0: never. Ceres's default of 1e-8 is not for BAL: a few points run off, "
              "and against their coordinates every step is short.");
// Of the program.
DECLARE_bool(autodiff);
DECLARE_string(trust_region);

namespace inceres::tools {
namespace {

// A flag that would change nothing is a mistake of the caller's.
Status CheckKind(const std::string& kind) {
  if (FLAGS_seed < 0) {
    return Invalid("--seed " + std::to_string(FLAGS_seed) + ": must be at least 0");
  }
  if (!(FLAGS_outliers >= 0.0 && FLAGS_outliers < 1.0)) {
    return Invalid("--outliers must be at least 0 and below 1");
  }
  if (kind != "g2o" && FLAGS_outliers > 0.0) {
    return Invalid("--outliers is for g2o: problems only");
  }
  const bool seed_is_of_use = FLAGS_seed == 1 || FLAGS_outliers > 0.0;
  if (kind != "bal" && kind != "path" &&
      (FLAGS_free_intrinsics || FLAGS_no_priors || !seed_is_of_use)) {
    return Invalid(
        "--free_intrinsics, --no_priors and --seed are for bal: and path: problems only");
  }
  if (kind != "bal" && !FLAGS_presolve) {
    return Invalid("--nopresolve is for bal: problems only");
  }
  if (kind != "path" && FLAGS_loops) {
    return Invalid("--loops is for path: problems only; other problems have the loops they have");
  }
  return Status::Ok();
}

Status MakeBalScript(const std::string& path, ReplayScript* script) {
  BalProblem bal;
  Status status =
      ReadBal(path, &bal, ReadProgressPrinter(path, ProgressOutput()), ReadOptionsFromFlags());
  if (status.ok() && (bal.num_cameras < 2 || bal.observations.empty())) {
    status = Status::Error(StatusCode::kIo,
                           path + ": a replay needs two or more cameras, and observations");
  }
  if (status.ok() && FLAGS_presolve) {
    std::fprintf(Out(), "solving %s first, not timed\n", path.c_str());
    std::fflush(Out());
    const Heartbeat heartbeat(ProgressOutput(), "solving " + path);
    status = SolveForReplay(FLAGS_num_threads, &bal);
  }
  if (status.ok()) {
    BalReplayOptions options;
    options.free_intrinsics = FLAGS_free_intrinsics;
    options.priors = !FLAGS_no_priors;
    options.seed = static_cast<unsigned>(FLAGS_seed);
    *script = MakeBalReplay(bal, options);
  }
  return status;
}

Status MakeKeyframeScript(const std::string& path, ReplayScript* script) {
  KeyframeSequence sequence;
  Status status = ReadKeyframes(path, &sequence, ReadOptionsFromFlags());
  if (status.ok() && sequence.keyframes.size() < 2) {
    status = Status::Error(StatusCode::kIo, path + ": a replay needs two or more keyframes");
  }
  if (status.ok()) {
    *script = MakeKeyframeReplay(sequence);
  }
  return status;
}

Status MakeStereoScript(const std::string& folder, ReplayScript* script) {
  StereoOdometry odometry;
  Status status = ReadStereoOdometry(folder, &odometry);
  if (status.ok() && odometry.poses.size() < 2) {
    status = Status::Error(StatusCode::kIo, folder + ": a replay needs two or more poses");
  }
  if (status.ok()) {
    *script = MakeStereoReplay(odometry);
  }
  return status;
}

Status MakePoseGraphScript(const std::string& path, ReplayScript* script) {
  PoseGraph graph;
  Status status = ReadG2o(path, &graph, ReadOptionsFromFlags());
  if (status.ok() && graph.NumVertices() < 2) {
    status = Status::Error(StatusCode::kIo, path + ": a replay needs two or more poses");
  }
  const int first_wrong_edge = static_cast<int>(graph.edges.size());
  if (status.ok() && FLAGS_outliers > 0.0) {
    PoseGraphPlan plan;
    plan.solver.strategy = TrustRegionStrategyKind::kDogleg;
    plan.outliers = FLAGS_outliers;
    plan.seed = static_cast<std::uint64_t>(FLAGS_seed);
    PoseGraph reference;
    status = WithWrongLoops(plan, &graph, &reference);
  }
  if (status.ok()) {
    status = MakePoseGraphReplay(graph, script, first_wrong_edge);
    // What is wrong is in the file, not in the flags.
    status = status.ok() ? status : Status::Error(StatusCode::kIo, path + ": " + status.message);
  }
  return status;
}

Status MakeVioScript(const std::string& name, ReplayScript* script) {
  VioSequence sequence;
  const Status status = OpenVioSequence(name, &sequence);
  return status.ok() ? MakeVioReplay(sequence, VioReplayOptions(), script) : status;
}

Status MakePathScript(const std::string& size, ReplayScript* script) {
  char* end = nullptr;
  const long num_cameras = std::strtol(size.c_str(), &end, 10);
  if (*end != '\0' || num_cameras < 0 || num_cameras > std::numeric_limits<int>::max()) {
    return Invalid("--problem path:" + size + ": a number of cameras is wanted");
  }
  PathReplayOptions options;
  options.num_cameras = static_cast<int>(num_cameras);
  options.loops = FLAGS_loops;
  options.free_intrinsics = FLAGS_free_intrinsics;
  options.priors = !FLAGS_no_priors;
  options.seed = static_cast<unsigned>(FLAGS_seed);
  return MakePathReplay(options, script);
}

}  // namespace

Status MakeScriptFromFlags(ReplayScript* script) {
  using Make = Status (*)(const std::string&, ReplayScript*);
  const std::map<std::string, Make> kinds = {
      {"bal", MakeBalScript},       {"kf", MakeKeyframeScript}, {"stereo", MakeStereoScript},
      {"g2o", MakePoseGraphScript}, {"vio", MakeVioScript},     {"path", MakePathScript}};
  const std::size_t colon = FLAGS_problem.find(':');
  const auto kind = kinds.find(FLAGS_problem.substr(0, colon));
  if (colon == std::string::npos || colon + 1 == FLAGS_problem.size() || kind == kinds.end()) {
    return Invalid(
        "--problem '" + FLAGS_problem +
        "': use bal:FILE, kf:FILE, stereo:FOLDER, g2o:FILE, vio:FILE, vio:PRESET or path:N");
  }
  const Status status = CheckKind(kind->first);
  return status.ok() ? kind->second(FLAGS_problem.substr(colon + 1), script) : status;
}

Status ReadReplaySettings(const std::string& solver_flag, const std::string& solver, bool landmarks,
                          bool dogleg, ReplaySettings* settings) {
  for (const Status& status :
       {Choose("--trust_region", FLAGS_trust_region,
               {{"auto", dogleg}, {"lm", false}, {"dogleg", true}}, &settings->dogleg),
        ParseReplayLinearSolver(solver_flag, solver, landmarks, &settings->linear_solver),
        CheckNumbers({{"--num_threads", FLAGS_num_threads, 1},
                      {"--max_num_iterations", FLAGS_max_num_iterations, 1}},
                     {{"--function_tolerance", FLAGS_function_tolerance},
                      {"--gradient_tolerance", FLAGS_gradient_tolerance},
                      {"--parameter_tolerance", FLAGS_parameter_tolerance}})}) {
    if (!status.ok()) {
      return status;
    }
  }
  settings->autodiff = FLAGS_autodiff;
  settings->num_threads = FLAGS_num_threads;
  settings->max_num_iterations = FLAGS_max_num_iterations;
  settings->function_tolerance = FLAGS_function_tolerance;
  settings->gradient_tolerance = FLAGS_gradient_tolerance;
  settings->parameter_tolerance = FLAGS_parameter_tolerance;
  return Status::Ok();
}

}  // namespace inceres::tools
