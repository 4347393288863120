// Solves a BAL file with inceres or stock Ceres.

#include <cstdio>
#include <memory>
#include <string>
#include <utility>

#include <gflags/gflags.h>
#include <glog/logging.h>
#include <nlohmann/json.hpp>

#include "inceres/io/bal.h"
#include "src/base/text.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/json_values.h"
#include "tools/command_line/output.h"
#include "tools/command_line/read_flags.h"
#include "tools/command_line/read_progress.h"
#include "tools/command_line/text_file.h"
#include "tools/draw/bal_page.h"
#include "tools/draw/bal_picture.h"
#include "tools/problems/bal_ceres_problem.h"
#include "tools/problems/problem_source.h"
#include "tools/solve/run_solver.h"
#include "tools/solve/solver_flags.h"
#include "tools/solve/stock_threads.h"

DEFINE_string(input, "", "The BAL file to solve: text, .gz or .bz2. Required.");
DEFINE_string(solver, "inceres", "inceres, or ceres for stock Ceres.");
DEFINE_string(output, "", "Write the solved problem to this BAL file (.gz and .bz2 compress).");
DEFINE_bool(landmarks_first, false,
            "Put points before cameras in the ordering of the ceres::Problem, instead of leaving "
            "the order to the solver.");
DEFINE_string(picture, "",
              "Show before and after in this file. NAME.html: a page with cameras and points from "
              "above and from the side, the cost curve, a histogram of the reprojection errors and "
              "the figures. Any other name: an SVG picture with cameras and points from above and "
              "the cost curve.");

namespace inceres::tools {
namespace {

const ToolHelp kHelp = {
    "Solve a bundle-adjustment problem in BAL format and tell what became of it.",
    "A line an iteration, then a table. A solve that --max_num_iterations stopped is a success.",
    {{"a table of the iterations and of the result", "bal_solve --input problem-49-7776-pre.txt"},
     {"the solved file, and a page to show a colleague",
      "bal_solve --input problem.txt.bz2 --robust huber:1.5 --output solved.txt --picture "
      "solved.html"},
     {"with the solver that re-uses Jacobians, and the built-in factors",
      "bal_solve --input problem.txt --mode incremental --builtin_factors"},
     {"with stock Ceres, and the figures for programs",
      "bal_solve --input problem.txt --solver ceres --linear_solver sparse_schur --num_threads 4 "
      "--json solved.json"},
     {"JSON into a pipe",
      "bal_solve --input problem.txt --json - | python3 -m json.tool --compact"}}};

struct Solved {
  BalProblem before;
  BalProblem after;
  SolveRecord record;
  std::string description;
  std::string solver;
};

Status ReadPlan(RunPlan* plan) {
  Status status = ReadSolverFlags(&plan->settings);
  if (!status.ok()) {
    return status;
  }
  if (FLAGS_input.empty()) {
    return Invalid("--input FILE is required; see --help");
  }
  if (FLAGS_solver != "inceres" && FLAGS_solver != "ceres") {
    return Invalid("--solver '" + FLAGS_solver + "': use inceres or ceres");
  }
  if (FLAGS_solver == "ceres" && plan->settings.builtin_factors) {
    return Invalid(
        "--builtin_factors needs --solver inceres: stock Ceres knows only cost functions");
  }
  if (FLAGS_landmarks_first && plan->settings.builtin_factors) {
    return Invalid("--landmarks_first is for cost functions: built-in factors need no ordering");
  }
  if (FLAGS_solver == "ceres" && plan->settings.incremental) {
    return Invalid("--mode incremental needs --solver inceres: stock Ceres has no such mode");
  }
  plan->engine = FLAGS_solver == "ceres"          ? Engine::kStock
                 : plan->settings.builtin_factors ? Engine::kCore
                                                  : Engine::kShim;
  plan->landmarks_first = FLAGS_landmarks_first;
  plan->strict = true;  // who asks for inceres gets inceres or an error
  return Status::Ok();
}

// A dense reduced system is the faster one up to a few hundred cameras.
ceres::LinearSolverType AutomaticLinearSolver(const BalProblem& bal) {
  constexpr int kMaxDenseCameras = 200;
  return bal.num_cameras <= kMaxDenseCameras ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
}

void PrintTable(const Solved& solved) {
  const SolveRecord& record = solved.record;
  std::fprintf(Out(), "\n%-22s %s\n%-22s %s (%s)\n", "problem", solved.description.c_str(),
               "solver", solved.solver.c_str(), record.linear_solver.c_str());
  std::fprintf(Out(), "%-22s %.10e -> %.10e\n", "cost", record.initial_cost, record.final_cost);
  std::fprintf(Out(), "%-22s %.6f -> %.6f px\n", "RMS reprojection error",
               RmsReprojectionError(solved.before), RmsReprojectionError(solved.after));
  std::fprintf(Out(), "%-22s %d\n%-22s %s: %s\n", "iterations", record.iterations, "termination",
               record.termination.c_str(), record.message.c_str());
  std::fprintf(Out(), "%-22s %.6f s\n", "time", record.seconds);
  for (const auto& [stage, seconds] : record.stage_seconds) {
    std::fprintf(Out(), "  %-20s %.6f s\n", stage.c_str(), seconds);
  }
  for (const auto& [name, count] : record.work) {
    std::fprintf(Out(), "  %-20s %lld\n", name.c_str(), static_cast<long long>(count));
  }
  for (const std::string& option : record.options_without_effect) {
    std::fprintf(Out(), "note: accepted without effect: %s\n", option.c_str());
  }
}

nlohmann::json ToJson(const SolverSettings& settings, const Solved& solved) {
  const SolveRecord& record = solved.record;
  nlohmann::json iterations = nlohmann::json::array();
  for (const CostSample& sample : record.trace) {
    iterations.push_back(
        {{"seconds", sample.seconds}, {"cost", sample.cost}, {"accepted", sample.accepted}});
  }
  return {{"input", FLAGS_input},
          {"solver", solved.solver},
          {"linear_solver", record.linear_solver},
          {"threads", settings.num_threads},
          {"robust", ToString(settings.robust)},
          {"num_cameras", solved.before.num_cameras},
          {"num_points", solved.before.num_points},
          {"num_observations", solved.before.observations.size()},
          {"initial_cost", record.initial_cost},
          {"final_cost", record.final_cost},
          {"initial_rms_pixels", RmsReprojectionError(solved.before)},
          {"final_rms_pixels", RmsReprojectionError(solved.after)},
          {"iterations", record.iterations},
          {"termination", record.termination},
          {"message", record.message},
          {"seconds", record.seconds},
          {"stage_seconds", JsonObject(record.stage_seconds)},
          {"work", JsonObject(record.work)},
          {"trace", iterations},
          {"options_without_effect", record.options_without_effect}};
}

std::string Picture(const SolverSettings& settings, const Solved& solved) {
  const std::string name = FLAGS_input.substr(FLAGS_input.rfind('/') + 1);
  if (!internal::EndsWith(FLAGS_picture, ".html")) {
    return BalPictureSvg(name + ": " + solved.description, solved.before, solved.after,
                         solved.record.trace);
  }
  BalPageContent content;
  content.title = name;
  content.solver = solved.solver;
  content.robust = ToString(settings.robust);
  content.num_threads = settings.num_threads;
  content.before = &solved.before;
  content.after = &solved.after;
  content.record = &solved.record;
  return BalPageHtml(content);
}

// Writes what was asked for; the first failure ends it.
Status WriteFiles(const SolverSettings& settings, const Solved& solved) {
  Status status;
  if (!FLAGS_output.empty()) {
    status = WriteBal(FLAGS_output, solved.after);
  }
  if (status.ok() && WantsJson()) {
    status = WriteJsonReport(ToJson(settings, solved));
  }
  if (status.ok() && !FLAGS_picture.empty()) {
    status = WriteTextFile(FLAGS_picture, Picture(settings, solved));
  }
  return status;
}

Status Main() {
  RunPlan plan;
  Status status = ReadPlan(&plan);
  if (!status.ok()) {
    return status;
  }
  KeepStockOnItsThreads(plan.settings.num_threads);
  BalProblem bal;
  status = ReadBal(FLAGS_input, &bal, ReadProgressPrinter(FLAGS_input, ProgressOutput()),
                   ReadOptionsFromFlags());
  if (!status.ok()) {
    return status;
  }
  plan.linear_solver = LinearSolverOr(plan.settings, AutomaticLinearSolver(bal));
  ProgressTable progress;
  plan.progress = &progress;
  const BalSource source(std::move(bal));
  RunOutcome outcome;
  {  // incremental mode calls nobody meanwhile
    const Heartbeat heartbeat(plan.settings.incremental ? ProgressOutput() : nullptr, "solving");
    status = Run(plan, source, &outcome);
  }
  if (!status.ok()) {
    return status;
  }
  if (!outcome.record.usable) {
    return Status::Error(
        StatusCode::kEvaluationFailed,
        "not solved: " + outcome.record.termination + ": " + outcome.record.message);
  }
  Solved solved{source.bal(), source.WithParameters(outcome.parameters), outcome.record,
                source.Describe(),
                FLAGS_solver + (plan.settings.incremental ? ", incremental" : "") +
                    (plan.settings.builtin_factors ? ", with built-in factors" : "")};
  PrintTable(solved);
  return WriteFiles(plan.settings, solved);
}

}  // namespace
}  // namespace inceres::tools

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  FLAGS_logtostderr = true;
  return inceres::tools::RunTool(inceres::tools::kHelp, argc, argv, inceres::tools::Main);
}
