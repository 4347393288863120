// Plays a problem that arrives step by step to inceres and to stock Ceres, side by side.

#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <gflags/gflags.h>
#include <glog/logging.h>

#include "tools/ab/environment.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/command_line/progress_lines.h"
#include "tools/replay/replay_ceres_solve.h"
#include "tools/replay/replay_flatness.h"
#include "tools/replay/replay_report.h"
#include "tools/replay/replay_run.h"
#include "tools/replay_problem.h"
#include "tools/solve/stock_threads.h"

DECLARE_string(problem);
DECLARE_int32(seed);
DECLARE_int32(num_threads);
DECLARE_double(function_tolerance);
DECLARE_double(parameter_tolerance);
DEFINE_string(mode, "incremental",
              "How inceres solves: incremental (the solver that remembers: Levenberg-Marquardt in "
              "its own metric, stopped by "
              "--function_tolerance alone; the other tolerances and --trust_region are stock's "
              "then) or exact (its batch solver, warm).");
DEFINE_bool(autodiff, false,
            "Give both sides AutoDiff cost functions instead of the same analytic factors.");
DEFINE_bool(stock_autodiff, false,
            "Give stock AutoDiff cost functions, as its users write them, while ours keeps its "
            "built-in factors.");
DEFINE_bool(stock, true,
            "Let stock Ceres play too. Without it the report is ours alone, and no optimum is "
            "sought unless --optimum is given.");
DEFINE_bool(gnc, false,
            "g2o only, with --mode incremental --nostock: find wrong loops by graduated "
            "non-convexity on the graph that lives on (LivingGnc); the last line tells how many.");
DEFINE_bool(covariance, false,
            "With --mode incremental, without --gnc: after each step take the marginal covariance "
            "of the newest frame and of another from the live factor; the JSON report has the "
            "nanoseconds of each (covariance_ns_newest, covariance_ns_any), which the step's time "
            "leaves out.");
DEFINE_bool(flat, false,
            "Also compare the cost of a step around step 200 with that of the last hundred steps.");
DEFINE_int32(checkpoints, 0,
             "Look for the optimum after so many steps only, evenly spread, the last among them; "
             "0: after all.");
DEFINE_bool(beside_batch, false,
            "Also solve each step's graph by the batch solver, from the values ours began with, "
            "by the strategy and tolerances of --mode exact, and tell which steps took longer.");
DEFINE_int32(steps, 0, "Stop after this many steps; 0: play all.");
DEFINE_string(trust_region, "auto",
              "Strategy of stock, and of ours with --mode exact: lm, dogleg, or auto: lm for bal, "
              "stereo and path, dogleg for "
              "kf, g2o and vio.");
DEFINE_string(stock_linear_solver, "auto",
              "Linear solver of stock Ceres: dense_schur or sparse_schur, landmarks first; "
              "sparse_normal_cholesky; or auto: "
              "dense_schur where there are landmarks, else sparse_normal_cholesky.");
DEFINE_bool(optimum, true,
            "After each step look for the minimum that stock LM reaches at tolerances of 1e-12. "
            "Slow, not timed.");
DEFINE_int32(
    print_every, 5,
    "Print every so many steps, at least 1; steps that close a loop or fail are always printed.");
DEFINE_int32(
    structure_step, 0,
    "Add to the JSON report the blocks of the reduced system after this step; 0: of none.");

namespace inceres::tools {
namespace {

const ToolHelp kHelp = {
    "Play a problem that grows step by step to inceres and stock Ceres, side by side.",
    "Both solve it again, warm, after each step, in lockstep and at the same tolerances. The solve "
    "calls are timed, and apart from them what it takes to add a step to each side's problem.\n"
    "bal: cameras in index order with the points that two of them see, near the solution of the "
    "whole file, with priors.\n"
    "kf: a keyframe sequence with inverse-depth landmarks and loop closures.\n"
    "stereo: the poses of a stereo odometry with the points that two of them see.\n"
    "g2o: a pose graph, pose by pose, planar or spatial; edges to poses more than ten before are "
    "loops.\n"
    "vio: frames of a visual-inertial sequence, with points in the world; analytic factors only.\n"
    "path: cameras along a generated path, each seeing about 40 points; with --loops it comes back "
    "to places seen before.\n"
    "A step of ours that fails is exit code 1, after the report.",
    {{"Ladybug-49, camera by camera", "replay --problem bal:problem-49-7776-pre.txt"},
     {"its first twenty cameras, without what holds them",
      "replay --problem bal:problem.txt --no_priors --free_intrinsics --steps 20"},
     {"keyframes against stock as its users write it, for programs",
      "replay --problem kf:fr3_office.kf --stock_autodiff --json report.json"},
     {"wrong loops among right ones, found as they come",
      "replay --problem g2o:M3500.g2o --nostock --gnc --outliers 0.2 --seed 3"},
     {"which steps cost more than a batch solve; excess at ten checkpoints",
      "replay --problem g2o:M3500.g2o --nostock --beside_batch --optimum --checkpoints 10"},
     {"whether a step of a long path costs what one of a short path does",
      "replay --problem path:2000 --nostock --flat"}}};

bool FindOptimum() {
  return FLAGS_optimum &&
         (FLAGS_stock || !gflags::GetCommandLineFlagInfoOrDie("optimum").is_default);
}

Status CheckFlags() {
  bool incremental = true;
  ReplaySettings unused;
  for (const Status& status :
       {Choose("--mode", FLAGS_mode, {{"incremental", true}, {"exact", false}}, &incremental),
        ReadReplaySettings("--stock_linear_solver", FLAGS_stock_linear_solver, true, false,
                           &unused)}) {
    if (!status.ok()) {
      return status;
    }
  }
  if (FLAGS_stock_autodiff && (FLAGS_autodiff || !FLAGS_stock)) {
    return Invalid(std::string("--stock_autodiff: ") +
                   (FLAGS_autodiff ? "--autodiff says that already" : "--nostock leaves it out"));
  }
  if (FLAGS_gnc && (!incremental || FLAGS_stock || FindOptimum())) {
    return Invalid("--gnc: needs --mode incremental and --nostock: its weights are its own");
  }
  if (FLAGS_covariance && (!incremental || FLAGS_gnc)) {
    return Invalid("--covariance: needs --mode incremental, and not --gnc");
  }
  if (FLAGS_gnc && FLAGS_problem.compare(0, 4, "g2o:") != 0) {
    return Invalid("--gnc is for g2o: problems only");
  }
  if (FLAGS_structure_step > 0 && (!incremental || !WantsJson())) {
    return Invalid("--structure_step: needs --mode incremental and --json");
  }
  if (FLAGS_beside_batch && (FLAGS_gnc || FLAGS_autodiff)) {
    return Invalid("--beside_batch: the batch solver has the built-in factors, and all of them");
  }
  if (FLAGS_checkpoints > 0 && !FindOptimum()) {
    return Invalid("--checkpoints: no optimum is sought without stock or --optimum");
  }
  return CheckNumbers({{"--steps", FLAGS_steps, 0},
                       {"--checkpoints", FLAGS_checkpoints, 0},
                       {"--print_every", FLAGS_print_every, 1},
                       {"--structure_step", FLAGS_structure_step, 0}},
                      {});
}

ReplaySettings Settings(const ReplayScript& script) {
  ReplaySettings settings;
  static_cast<void>(  // CheckFlags has seen it
      ReadReplaySettings("", FLAGS_stock_linear_solver, HasLandmarks(script), script.dogleg,
                         &settings));
  settings.gnc = FLAGS_gnc;
  settings.covariance = FLAGS_covariance;
  return settings;
}

void PrintRow(const ReplayRow& row) {
  const bool failed =
      !row.ours.outcome.usable || (row.stock.has_value() && !row.stock->outcome.usable);
  if (row.step == 1 || row.step % FLAGS_print_every == 0 || row.closes_loop || failed) {
    std::fputs(ReplayTableLine(row).c_str(), Out());
    std::fflush(Out());
  }
}

ReplayContext Context(const ReplayScript& script, const ReplaySolver& ours,
                      const ReplaySolver* stock) {
  ReplayContext context;
  context.problem = FLAGS_problem;
  context.description = script.description;
  context.ours = ours.Name();
  context.stock = stock != nullptr ? stock->Name() : "";
  context.threads = FLAGS_num_threads;
  context.seed = static_cast<unsigned>(FLAGS_seed);
  context.function_tolerance = FLAGS_function_tolerance;
  context.parameter_tolerance = FLAGS_parameter_tolerance;
  context.environment = DescribeEnvironment();
  return context;
}

// What was found of the loops of the last step, which are all that came.
void PrintVerdicts(const std::vector<ReplayRow>& rows) {
  std::int64_t counts[4] = {};
  const char* const names[4] = {"num_wrong_found", "num_wrong", "num_right_lost", "num_suspects"};
  for (const auto& [name, count] : rows.back().ours.outcome.work) {
    for (int k = 0; k < 4; ++k) {
      counts[k] = name == names[k] ? count : counts[k];
    }
  }
  std::fprintf(Out(), "wrong loops found: %lld of %lld; right ones lost: %lld of %lld\n",
               static_cast<long long>(counts[0]), static_cast<long long>(counts[1]),
               static_cast<long long>(counts[2]), static_cast<long long>(counts[3] - counts[1]));
}

Status Report(const ReplayContext& context, const ReplaySummary& summary,
              const std::vector<ReplayRow>& rows,
              const std::optional<ReducedStructure>& structure) {
  std::fputs(ReplaySummaryText(context, summary).c_str(), Out());
  if (FLAGS_gnc && !rows.empty()) {
    PrintVerdicts(rows);
  }
  nlohmann::json json = WantsJson() ? ReplayJson(context, summary, rows) : nlohmann::json();
  if (FLAGS_flat) {
    const ReplayFlatness flatness = MeasureFlatness(rows);
    std::fputs(FlatnessText(flatness).c_str(), Out());
    json["flat"] = FlatnessJson(flatness);
  }
  if (structure.has_value()) {
    json["structure"] = StructureJson(FLAGS_structure_step, *structure);
  }
  return WriteJsonReport(json);
}

int Play(const ReplayScript& script) {
  const ReplaySettings settings = Settings(script);
  ReplaySettings stock_settings = settings;
  stock_settings.autodiff = settings.autodiff || FLAGS_stock_autodiff;
  const std::unique_ptr<ReplaySolver> ours = FLAGS_mode == "incremental"
                                                 ? MakeIncrementalReplaySolver(settings)
                                                 : MakeExactReplaySolver(settings);
  const std::unique_ptr<ReplaySolver> stock =
      FLAGS_stock ? MakeStockReplaySolver(stock_settings) : nullptr;
  const std::unique_ptr<ReplaySolver> batch =
      FLAGS_beside_batch ? MakeExactReplaySolver(settings) : nullptr;
  ReplayReference judge(settings);
  std::fprintf(Out(), "%s: %s\n%s", FLAGS_problem.c_str(), script.description.c_str(),
               ReplayTableHeader().c_str());
  std::vector<ReplayRow> rows;
  std::optional<ReducedStructure> structure;
  ProgressLines progress(ProgressOutputBesideTable());
  const auto look_at = [&](const ReplayRow& row) {
    PrintRow(row);
    progress([&] {
      return "step " + std::to_string(row.step) + " of " +
             std::to_string(NumSteps(script, FLAGS_steps));
    });
    if (row.step == FLAGS_structure_step) {
      structure = ours->Structure();
    }
  };
  Status status = RunReplay(script, {FLAGS_steps, FindOptimum(), FLAGS_checkpoints, !FLAGS_gnc},
                            ours.get(), stock.get(), batch.get(), &judge, look_at, &rows);
  if (!status.ok()) {
    return Fail(kExitFailure, status.message);
  }
  const ReplaySummary summary = Summarize(rows, FLAGS_function_tolerance);
  status = Report(Context(script, *ours, stock.get()), summary, rows, structure);
  if (!status.ok()) {
    return Fail(kExitFailure, status.message);
  }
  return summary.ours.failed.empty()
             ? static_cast<int>(kExitSuccess)
             : Fail(kExitFailure,
                    std::to_string(summary.ours.failed.size()) + " of our solves failed");
}

// --flat needs room for both of its windows, --structure_step its step.
Status CheckLength(const ReplayScript& script) {
  const int steps = static_cast<int>(NumSteps(script, FLAGS_steps));
  if (FLAGS_structure_step > steps) {
    return Invalid("--structure_step " + std::to_string(FLAGS_structure_step) + ": there are " +
                   std::to_string(steps) + " steps");
  }
  return !FLAGS_flat || steps >= kMinFlatnessSteps
             ? Status::Ok()
             : Invalid("--flat: " + std::to_string(steps) + " steps are too few, " +
                       std::to_string(kMinFlatnessSteps) + " are needed");
}

int Main() {
  ReplayScript script;
  Status status = CheckFlags();
  status = status.ok() ? CheckFoldersToWrite() : status;
  KeepStockOnItsThreads(FLAGS_num_threads);
  status = status.ok() ? MakeScriptFromFlags(&script) : status;
  status = status.ok() ? CheckLength(script) : status;
  if (!status.ok()) {
    const bool usage =
        status.code == StatusCode::kInvalidArgument || status.code == StatusCode::kUnavailable;
    return Fail(usage ? kExitUsage : kExitFailure, status.message);
  }
  return Play(script);
}

}  // namespace
}  // namespace inceres::tools

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  FLAGS_logtostderr = true;
  // stock warns of every failed factorization; the report counts them
  FLAGS_minloglevel = google::GLOG_ERROR;
  const auto exit_code = inceres::tools::ParseCommandLine(inceres::tools::kHelp, &argc, &argv);
  return exit_code ? *exit_code : inceres::tools::Main();
}
