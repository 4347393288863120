// Ours and stock Ceres on one problem, side by side.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <gflags/gflags.h>
#include <glog/logging.h>

#include "tools/ab/ab_protocol.h"
#include "tools/ab/ab_report.h"
#include "tools/ab/environment.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/command_line/progress_lines.h"
#include "tools/command_line/text_file.h"
#include "tools/problems/problem_source.h"
#include "tools/solve/run_solver.h"
#include "tools/solve/solver_flags.h"
#include "tools/solve/stock_threads.h"

DEFINE_string(problem, "",
              "The problem: bal:FILE (text, .gz or .bz2), g2o:FILE, vio:FILE or vio:PRESET (cubic, "
              "figure_eight, ellipse).");
DEFINE_bool(analytic, false,
            "bal only: give stock, and inceres on a ceres::Problem, our analytic factors as cost "
            "functions instead of AutoDiff.");
DEFINE_bool(
    inceres_autodiff, false,
    "bal only: give inceres, on a ceres::Problem, inceres::AutoDiffCostFunction of the same "
    "functors; stock keeps ceres::AutoDiffCostFunction.");
DEFINE_bool(inner_iterations, false,
            "use_inner_iterations, in the order that each chooses, for both: coordinate descent "
            "after each step. In exact mode, with cost functions.");
DEFINE_int32(repeats, 11, "Rounds in which every solver runs once, at least 1.");
DEFINE_string(
    configurations, "",
    "Comma-separated stock configurations to run, without the pre-pass that drops slow "
    "ones: dense_schur, dense_schur_points_first, sparse_schur, sparse_schur_points_first, "
    "iterative_schur, iterative_schur_points_first (all of these for bal and vio), "
    "sparse_normal_cholesky. By default all that make sense for the problem but the "
    "iterative ones; with --linear_solver iterative_schur these and the sparse ones.");
DEFINE_string(picture, "",
              "Show in this SVG file how each came near the lowest cost over time, of the first "
              "round.");
DEFINE_double(tolerance, 1e-6,
              "Exit with code 3 if our final cost is above the lowest of stock by more than this, "
              "relative. Negative: it must be lower.");

namespace inceres::tools {
namespace {

const ToolHelp kHelp = {
    "Solve a problem with inceres and with stock Ceres, interleaved, and compare.",
    "Stock runs in each of its sensible configurations, all from the same start values. Each run "
    "builds the ceres::Problem anew, untimed, and times the whole Solve call. The report has "
    "seconds, costs and parameters.",
    {{"Ladybug-49, and the report for programs",
      "ab_compare --problem bal:problem-49-7776-pre.txt --json ab.json"},
     {"a pose graph", "ab_compare --problem g2o:sphere.g2o --repeats 5 --trust_region dogleg"},
     {"a simulated visual-inertial sequence",
      "ab_compare --problem vio:cubic --trust_region dogleg"},
     {"ours with inceres::AutoDiffCostFunction, stock with its own",
      "ab_compare --problem bal:problem.txt --inceres_autodiff"},
     {"inner iterations", "ab_compare --problem bal:problem.txt --inner_iterations"},
     {"conjugate gradients, and a picture of cost against time",
      "ab_compare --problem bal:problem.txt --linear_solver iterative_schur --preconditioner "
      "cluster_jacobi --picture curves.svg"},
     {"all of ten iterations",
      "ab_compare --problem bal:problem.txt --max_num_iterations 10 --function_tolerance 0 "
      "--gradient_tolerance 0 --parameter_tolerance 0"}},
    {{kExitWorse, "our final cost is above the best stock run's by more than --tolerance"},
     {kExitUsedStock, "inceres handed the problem to stock Ceres: no measurement"}}};

struct Configuration {
  const char* name;
  ceres::LinearSolverType linear_solver;
  bool landmarks_first;
  bool needs_landmarks;
  bool by_default;  // among problems with (Schur) or without (others) landmarks
};

constexpr Configuration kConfigurations[] = {
    {"dense_schur", ceres::DENSE_SCHUR, false, true, true},
    {"dense_schur_points_first", ceres::DENSE_SCHUR, true, true, true},
    {"sparse_schur", ceres::SPARSE_SCHUR, false, true, true},
    {"sparse_schur_points_first", ceres::SPARSE_SCHUR, true, true, true},
    {"iterative_schur", ceres::ITERATIVE_SCHUR, false, true, false},
    {"iterative_schur_points_first", ceres::ITERATIVE_SCHUR, true, true, false},
    {"sparse_normal_cholesky", ceres::SPARSE_NORMAL_CHOLESKY, false, false, true},
};

Status ChooseConfigurations(const std::string& list, bool has_landmarks, bool iterative,
                            std::vector<Configuration>* chosen) {
  if (list.empty()) {
    std::copy_if(std::begin(kConfigurations), std::end(kConfigurations),
                 std::back_inserter(*chosen), [=](const Configuration& c) {
                   const bool of_iterative = c.linear_solver == ceres::ITERATIVE_SCHUR ||
                                             c.linear_solver == ceres::SPARSE_SCHUR;
                   return (iterative ? of_iterative : c.by_default) &&
                          c.needs_landmarks == has_landmarks;
                 });
    return Status::Ok();
  }
  std::istringstream names(list);
  for (std::string name; std::getline(names, name, ',');) {
    const auto* found = std::find_if(std::begin(kConfigurations), std::end(kConfigurations),
                                     [&](const Configuration& c) { return c.name == name; });
    if (found == std::end(kConfigurations) || (found->needs_landmarks && !has_landmarks)) {
      return Invalid(
          "--configurations: '" + name + "' is " +
          (found == std::end(kConfigurations) ? "unknown" : "for problems with landmarks") +
          "; see --help");
    }
    chosen->push_back(*found);
  }
  return Status::Ok();
}

Contender MakeContender(const RunPlan& plan, const std::string& configuration,
                        const ProblemSource& source) {
  const auto run = [plan, &source](std::optional<int> iteration_limit, RunOutcome* outcome) {
    RunPlan limited = plan;
    limited.settings.max_num_iterations =
        std::min(plan.settings.max_num_iterations,
                 iteration_limit.value_or(plan.settings.max_num_iterations));
    return Run(limited, source, outcome);
  };
  return {plan.engine == Engine::kStock ? "ceres" : "inceres", configuration, run};
}

Contender MakeOurs(const SolverSettings& settings, const ProblemSource& source) {
  RunPlan plan;
  plan.settings = settings;
  plan.engine = settings.builtin_factors ? Engine::kCore : Engine::kShim;
  plan.linear_solver = LinearSolverOr(
      settings, source.HasLandmarks() ? ceres::DENSE_SCHUR : ceres::SPARSE_NORMAL_CHOLESKY);
  std::string name =
      settings.builtin_factors && !settings.linear_solver ? "auto" : FlagName(plan.linear_solver);
  if (settings.incremental) {
    name = "incremental";
  }
  if (settings.builtin_factors) {
    name += " builtin_factors";
  } else if (FLAGS_inceres_autodiff) {
    name += " inceres_autodiff";
  }
  if (settings.inner_iterations) {
    name += " inner_iterations";
  }
  return MakeContender(plan, name, source);
}

// Which cost functions there are.
Status CheckJacobianFlags(const SolverSettings& settings) {
  const bool is_bal = FLAGS_problem.rfind("bal:", 0) == 0;
  const char* problem = nullptr;
  if (FLAGS_analytic && !is_bal) {
    problem = "--analytic: for bal: problems only; others have one kind of cost functions";
  } else if (FLAGS_inceres_autodiff && !is_bal) {
    problem = "--inceres_autodiff: for bal: problems only";
  } else if (FLAGS_inceres_autodiff && (FLAGS_analytic || settings.builtin_factors)) {
    problem =
        "--inceres_autodiff: not together with --analytic or --builtin_factors, which have other "
        "Jacobians";
  }
  return problem == nullptr ? Status::Ok() : Invalid(problem);
}

// What each flag allows but not all together.
Status CheckCombination(const SolverSettings& settings, const ProblemSource& source) {
  if (settings.inner_iterations && (settings.builtin_factors || settings.incremental)) {
    return Invalid("--inner_iterations: not with --builtin_factors or --mode incremental");
  }
  if (!settings.builtin_factors) {
    ceres::Solver::Options unused;
    return ToCeresOptions(settings, LinearSolverOr(settings, ceres::SPARSE_NORMAL_CHOLESKY),
                          &unused);
  }
  if (!source.HasLandmarks()) {
    return Invalid("--builtin_factors: there are built-in factors for bal: and vio: problems only");
  }
  if (settings.incremental) {
    IncrementalOptions unused;
    std::vector<std::string> unused_flags;
    return ToIncrementalOptions(settings, &unused, &unused_flags);
  }
  SolverOptions unused;
  return ToCoreOptions(settings, &unused);
}

std::vector<Contender> MakeStock(const SolverSettings& settings,
                                 const std::vector<Configuration>& configurations,
                                 const ProblemSource& source) {
  std::vector<Contender> stock;
  for (const Configuration& configuration : configurations) {
    RunPlan plan;
    plan.settings = settings;
    plan.engine = Engine::kStock;
    plan.linear_solver = configuration.linear_solver;
    plan.landmarks_first = configuration.landmarks_first;
    stock.push_back(MakeContender(plan, configuration.name, source));
  }
  return stock;
}

// Prints and writes the report, and decides.
int Report(const SolverSettings& settings, const ProblemSource& source, const AbResult& result) {
  AbContext context;
  context.problem = FLAGS_problem;
  context.description = source.Describe();
  context.threads = settings.num_threads;
  context.settings = settings;
  context.difference = source.Difference(result.ours.parameters, result.FastestStock().parameters);
  context.environment = DescribeEnvironment();
  std::fputs(AbTable(context, result).c_str(), Out());
  for (const std::string& option : result.ours.first().options_without_effect) {
    std::fprintf(Out(), "note: inceres accepts this option without effect: %s\n", option.c_str());
  }
  if (!BlasIsSerialOpenBlas()) {
    std::fputs(
        "WARNING: the BLAS of this process is not the serial OpenBLAS; do not compare these times "
        "with others.\n",
        Out());
  }
  Status status;
  if (WantsJson()) {
    status = WriteJsonReport(AbJson(context, result));
  }
  if (status.ok() && !FLAGS_picture.empty()) {
    status = WriteTextFile(FLAGS_picture, AbPicture(context, result));
  }
  if (!status.ok()) {
    return Fail(kExitFailure, status.message);
  }
  if (!(result.RelativeCostDifference() <= FLAGS_tolerance)) {
    std::ostringstream message;
    message << "our final cost is higher than the best stock run's: by "
            << result.RelativeCostDifference() << ", --tolerance is " << FLAGS_tolerance
            << " (relative)";
    return Fail(kExitWorse, message.str());
  }
  return kExitSuccess;
}

int Main() {
  SolverSettings settings;
  Status status = ReadSolverFlags(&settings);
  if (!status.ok()) {
    return Fail(kExitUsage, status.message);
  }
  settings.inner_iterations = FLAGS_inner_iterations;
  if (FLAGS_repeats < 1 || !std::isfinite(FLAGS_tolerance)) {
    return Fail(kExitUsage, "--repeats must be at least 1 and --tolerance a finite number");
  }
  status = CheckJacobianFlags(settings);
  if (!status.ok()) {
    return Fail(kExitUsage, status.message);
  }
  KeepStockOnItsThreads(settings.num_threads);
  std::unique_ptr<ProblemSource> source;
  std::unique_ptr<ProblemSource> own_source;  // ours, where it is not the same
  status = OpenProblem(FLAGS_problem, &source,
                       FLAGS_analytic ? BalJacobians::kAnalytic : BalJacobians::kAutoDiff);
  if (status.ok() && FLAGS_inceres_autodiff) {
    status = OpenProblem(FLAGS_problem, &own_source, BalJacobians::kInceresAutoDiff);
  }
  if (!status.ok()) {
    return Fail(status.code == StatusCode::kInvalidArgument ? kExitUsage : kExitFailure,
                status.message);
  }
  std::vector<Configuration> configurations;
  status = ChooseConfigurations(FLAGS_configurations, source->HasLandmarks(),
                                settings.linear_solver == ceres::ITERATIVE_SCHUR, &configurations);
  status = status.ok() ? CheckCombination(settings, *source) : status;
  if (!status.ok()) {
    return Fail(kExitUsage, status.message);
  }
  AbOptions options;
  options.repeats = FLAGS_repeats;
  options.drop_slow = FLAGS_configurations.empty();
  AbResult result;
  ProgressLines progress(ProgressOutput());
  status = RunComparison(
      MakeOurs(settings, own_source ? *own_source : *source),
      MakeStock(settings, configurations, *source), options,
      [&](const std::string& line) { progress([&] { return line; }); }, &result);
  if (!status.ok()) {
    return Fail(status.code == StatusCode::kUnavailable ? kExitUsedStock : kExitFailure,
                status.message);
  }
  return Report(settings, *source, result);
}

}  // namespace
}  // namespace inceres::tools

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  FLAGS_logtostderr = true;
  const auto exit_code = inceres::tools::ParseCommandLine(inceres::tools::kHelp, &argc, &argv);
  return exit_code ? *exit_code : inceres::tools::Main();
}
