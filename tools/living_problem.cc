// A program that knows Ceres only and keeps a problem that grows: run bare, or with the drop-in
// preloaded.

#include <cstddef>
#include <cstdio>
#include <memory>
#include <string>

#include <gflags/gflags.h>
#include <glog/logging.h>

#include "tools/command_line/command_line.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/command_line/progress_lines.h"
#include "tools/replay/living_run.h"
#include "tools/replay_problem.h"

DECLARE_string(problem);
DEFINE_string(mode, "plain",
              "plain (one ceres::Problem, to which each step adds) or rebuild (a new one for every "
              "step, over the same parameter "
              "arrays, as VINS does).");
DEFINE_bool(oneshot, false,
            "Solve once instead: bal, g2o and vio as they stand in the file, other problems when "
            "all steps have been added.");
DEFINE_string(robust, "none",
              "--oneshot of bal, g2o and vio only: the loss of all residuals: none, huber:SCALE or "
              "cauchy:SCALE.");
DEFINE_bool(autodiff, false,
            "AutoDiff cost functions instead of analytic ones. A g2o file solved with --oneshot "
            "has AutoDiff ones anyway, vio has "
            "none.");
DEFINE_int32(steps, 0, "Stop after this many steps; 0: play all. Not for --oneshot.");
DEFINE_string(trust_region, "auto",
              "lm, dogleg, or auto: dogleg for kf, g2o and vio, lm for the others, and for bal, "
              "g2o and vio with --oneshot.");
DEFINE_string(linear_solver, "auto",
              "dense_schur or sparse_schur, landmarks first; sparse_normal_cholesky; or auto: "
              "dense_schur where there are "
              "landmarks, else sparse_normal_cholesky.");

namespace inceres::tools {
namespace {

const ToolHelp kHelp = {
    "Play a problem that grows to ceres::Solve, and know nothing of inceres.",
    "Edits of a ceres::Problem and ceres::Solve after each, linked to the shared Ceres. Run it "
    "bare, or with the drop-in preloaded and INCERES_MODE set. The problems are replay's, see "
    "replay --help. A solve that fails is exit code 1, after the report.",
    {{"keyframes, by stock Ceres", "living_problem --problem kf:fr3_office.kf"},
     {"a pose graph, by inceres in Ceres's place",
      "LD_PRELOAD=libinceres_dropin.so INCERES_MODE=incremental living_problem --problem "
      "g2o:M3500.g2o --steps 500"},
     {"one solve of a whole file",
      "living_problem --problem bal:problem-49-7776-pre.txt --oneshot --robust huber:1.0"}}};

bool IsFromFile() {
  const std::string kind = FLAGS_problem.substr(0, FLAGS_problem.find(':'));
  return FLAGS_oneshot && (kind == "bal" || kind == "g2o" || kind == "vio");
}

// A flag that would change nothing is a mistake of the caller's.
Status CheckCombination() {
  for (const char* flag : {"mode", "steps"}) {
    if (FLAGS_oneshot && IsSet(flag)) {
      return Invalid(std::string("--") + flag + ": --oneshot has no steps");
    }
  }
  for (const char* flag :
       {"free_intrinsics", "no_priors", "presolve", "loops", "seed", "outliers"}) {
    if (IsFromFile() && IsSet(flag)) {
      return Invalid(std::string("--") + flag +
                     ": --oneshot takes the problem as it stands in the file");
    }
  }
  return IsSet("robust") && !IsFromFile()
             ? Invalid(
                   "--robust is for --oneshot of bal, g2o and vio only; replays have their losses")
             : Status::Ok();
}

Status CheckFlags() {
  if (FLAGS_autodiff && FLAGS_problem.rfind("vio:", 0) == 0) {
    return Invalid("--autodiff: vio problems have analytic cost functions only");
  }
  LivingMode mode = LivingMode::kPlain;
  ReplaySettings unused;
  Status status = Choose("--mode", FLAGS_mode,
                         {{"plain", LivingMode::kPlain}, {"rebuild", LivingMode::kRebuild}}, &mode);
  status = status.ok()
               ? ReadReplaySettings("--linear_solver", FLAGS_linear_solver, true, false, &unused)
               : status;
  status = status.ok() ? CheckNumbers({{"--steps", FLAGS_steps, 0}}, {}) : status;
  return status.ok() ? CheckCombination() : status;
}

ReplaySettings Settings(bool landmarks, bool dogleg) {
  ReplaySettings settings;
  static_cast<void>(  // CheckFlags has seen it
      ReadReplaySettings("", FLAGS_linear_solver, landmarks, dogleg, &settings));
  return settings;
}

struct Run {
  std::string description;
  ReplaySettings settings;
  LivingReport report;
};

Status SolveFile(Run* run) {
  LossSpec loss;
  Status status = ParseLoss(FLAGS_robust, &loss);
  if (!status.ok()) {
    return Invalid("--robust " + status.message);
  }
  std::unique_ptr<ProblemSource> source;
  status = OpenProblem(FLAGS_problem, &source,
                       FLAGS_autodiff ? BalJacobians::kAutoDiff : BalJacobians::kAnalytic);
  if (!status.ok()) {
    return status;
  }
  run->description = source->Describe();
  run->settings = Settings(source->HasLandmarks(), false);
  return PlayAtOnce(*source, loss, run->settings, PlainCeresSolve, &run->report);
}

Status PlayScript(Run* run) {
  ReplayScript script;
  if (Status status = MakeScriptFromFlags(&script); !status.ok()) {
    return status;
  }
  run->description = script.description;
  run->settings = Settings(HasLandmarks(script), script.dogleg);
  if (FLAGS_oneshot) {
    return PlayAtOnce(script, 0, run->settings, PlainCeresSolve, &run->report);
  }
  const LivingMode mode = FLAGS_mode == "plain" ? LivingMode::kPlain : LivingMode::kRebuild;
  ProgressLines progress(ProgressOutput());
  const auto on_solve = [&progress](std::size_t solve, std::size_t num_solves) {
    progress(
        [&] { return "solve " + std::to_string(solve) + " of " + std::to_string(num_solves); });
  };
  return PlayLiving(script, FLAGS_steps, run->settings, mode, PlainCeresSolve, &run->report,
                    on_solve);
}

Status Report(const Run& run) {
  nlohmann::json json = ToJson(run.report);
  json["problem"] = FLAGS_problem;
  json["description"] = run.description;
  json["mode"] = FLAGS_oneshot ? "oneshot" : FLAGS_mode;
  json["linear_solver"] = DescribeLinearSolver(run.settings.linear_solver);
  json["trust_region"] = run.settings.dogleg ? "dogleg" : "lm";
  json["autodiff"] = run.settings.autodiff;
  const nlohmann::json& ms = json["solve_ms"];
  std::fprintf(
      Out(),
      "%s: %s\n%s, %s: %zu solves, ms median %.3g, p95 %.3g, max %.3g, total %.6g; %.3g s in all; "
      "last cost %.9e\n",
      FLAGS_problem.c_str(), run.description.c_str(),
      json["linear_solver"].get<std::string>().c_str(),
      json["trust_region"].get<std::string>().c_str(), run.report.solves.size(),
      ms["median"].get<double>(), ms["p95"].get<double>(), ms["max"].get<double>(),
      ms["total"].get<double>(), run.report.total_seconds, run.report.solves.back().final_cost);
  return WriteJsonReport(json);
}

// Names the first solve that failed.
Status CheckSolves(const LivingReport& report) {
  for (std::size_t i = 0; i < report.solves.size(); ++i) {
    if (!report.solves[i].usable) {
      return Status::Error(
          StatusCode::kEvaluationFailed,
          "solve " + std::to_string(i + 1) + " failed: " + report.solves[i].message);
    }
  }
  return Status::Ok();
}

Status Main() {
  Run run;
  Status status = CheckFlags();
  status = !status.ok() ? status : IsFromFile() ? SolveFile(&run) : PlayScript(&run);
  status = status.ok() ? Report(run) : status;
  return status.ok() ? CheckSolves(run.report) : status;
}

}  // namespace
}  // namespace inceres::tools

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  return inceres::tools::RunTool(inceres::tools::kHelp, argc, argv, inceres::tools::Main);
}
