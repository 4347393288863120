#include "adapters/ceres/compare/ab_log.h"

#include <fcntl.h>
#include <unistd.h>

#include <bitset>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <map>
#include <mutex>
#include <thread>

#include <ceres/version.h>
#include <glog/logging.h>

#include "adapters/ceres/compare/compare_solves.h"
#include "src/base/cpu_model.h"
#include "src/base/json_object.h"
#include "src/trust_region/summary_json.h"

namespace inceres::internal {
namespace {

// What this process knows of a log file. Never destroyed: solves may still run while the process
// ends.
struct LogState {
  std::int64_t num_solves = 0;
  std::uint64_t num_comparisons = 0;
  bool complained = false;
};

struct LogRegistry {
  std::mutex mutex;
  std::map<std::string, LogState> logs;
};

LogRegistry& Registry() {
  static auto* registry = new LogRegistry;
  return *registry;
}

void ComplainOnce(const std::string& path, const char* reason) {
  LogRegistry& registry = Registry();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  bool& complained = registry.logs[path].complained;
  if (!complained) {
    complained = true;
    LOG(WARNING) << "inceres: the A/B log " << path << " cannot be written (" << reason
                 << "); solves go on without it";
  }
}

// UTC with milliseconds.
std::string Now() {
  const auto now = std::chrono::system_clock::now();
  const std::time_t seconds = std::chrono::system_clock::to_time_t(now);
  const auto milliseconds =
      std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()).count() % 1000;
  std::tm parts;
  gmtime_r(&seconds, &parts);
  char text[48];
  const std::size_t length = std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%S", &parts);
  std::snprintf(text + length, sizeof(text) - length, ".%03dZ", static_cast<int>(milliseconds));
  return text;
}

const char* Name(SolveMode mode) {
  switch (mode) {
    case SolveMode::kExact:
      return "exact";
    case SolveMode::kIncremental:
      return "incremental";
    case SolveMode::kStock:
      return "stock";
  }
  return "unknown";
}

const char* Name(SolvedBy who) {
  return who == SolvedBy::kOurs ? "ours" : "stock";
}

std::string Sizes(const ceres::Solver::Summary& summary) {
  return JsonObject()
      .Add("parameter_blocks", summary.num_parameter_blocks_reduced)
      .Add("parameters", summary.num_parameters_reduced)
      .Add("effective_parameters", summary.num_effective_parameters_reduced)
      .Add("residual_blocks", summary.num_residual_blocks_reduced)
      .Add("residuals", summary.num_residuals_reduced)
      .Add("constant_parameter_blocks",
           summary.num_parameter_blocks - summary.num_parameter_blocks_reduced)
      .Close();
}

std::string Structure(const SolveReport& report, const ceres::Solver::Summary& summary) {
  JsonObject json;
  json.AddString("linear_solver_given",
                 ceres::LinearSolverTypeToString(summary.linear_solver_type_given))
      .AddString("linear_solver_used",
                 ceres::LinearSolverTypeToString(summary.linear_solver_type_used))
      .AddString("schur_structure", summary.schur_structure_used)
      .AddString("strategy",
                 ceres::TrustRegionStrategyTypeToString(summary.trust_region_strategy_type))
      .Add("threads", summary.num_threads_used);
  if (!report.used_stock) {
    json.Add("landmarks", report.num_landmarks)
        .Add("frames", report.num_frames)
        .AddString("reduced_solver", report.core.reduced_solver);
  }
  return json.Close();
}

JsonObject Outcome(const ceres::Solver::Summary& summary, double seconds) {
  JsonObject json;
  json.Add("seconds", seconds)
      .Add("initial_cost", summary.initial_cost)
      .Add("final_cost", summary.final_cost)
      .Add("iterations", summary.iterations.empty() ? 0 : summary.iterations.back().iteration)
      .AddString("termination", ceres::TerminationTypeToString(summary.termination_type))
      .AddString("message", summary.message);
  return json;
}

std::string OurOutcome(const SolveReport& report, SolveMode mode) {
  JsonObject json = Outcome(report.comparison->ours, report.comparison->our_seconds);
  json.AddString("kernels", report.core.kernels);
  if (mode == SolveMode::kIncremental) {
    json.AddRaw("update", report.update.ToJson());
  } else {
    json.AddRaw("stages", ToJson(report.core.seconds)).AddRaw("work", ToJson(report.core.work));
  }
  return json.Close();
}

std::string Judged(const JudgedTolerances& tolerances) {
  return JsonObject()
      .Add("cost", tolerances.cost)
      .Add("parameters", tolerances.parameters)
      .Add("iterations", tolerances.iterations)
      .Add("radius", tolerances.radius)
      .Close();
}

std::string Spread(const StockSpread& spread) {
  return JsonObject()
      .AddString("linear_solvers", spread.linear_solvers)
      .Add("cost", spread.cost)
      .Add("parameter", spread.parameter)
      .Add("iterations", spread.iterations)
      .Add("first_iteration", spread.first_different_iteration)
      .Add("seconds", spread.seconds)
      .Close();
}

std::string Differences(const CrossCheckResult& result, const JudgedTolerances& tolerances) {
  return JsonObject()
      .Add("cost", result.cost_difference)
      .Add("parameter", result.parameters.relative)
      .Add("parameter_block", result.parameters.index)
      .Add("parameter_block_size", result.parameters.size)
      .Add("component", result.parameters.component)
      .Add("iterations", static_cast<int>(result.ours.iterations.size()) -
                             static_cast<int>(result.stock.iterations.size()))
      .Add("first_iteration", result.first_different_iteration)
      .AddArray("violations", result.violations, JsonString)
      .AddArray("within_spread", result.within_spread, JsonString)
      .AddRaw("spread", result.spread ? Spread(*result.spread) : "null")
      .AddString("note", result.reason)
      .AddRaw("tolerances", Judged(tolerances))
      .Close();
}

std::string Machine() {
  static const std::string& kCpu =
      *new std::string(CpuModel());  // never destroyed, as the environment
  return JsonObject()
      .AddString("cpu", kCpu)
      .Add("hardware_threads", static_cast<int>(std::thread::hardware_concurrency()))
      .AddString("inceres", INCERES_VERSION)
      .AddString("ceres", CERES_VERSION_STRING)
      .Close();
}

}  // namespace

std::int64_t NextNumberInLog(const std::string& path) {
  LogRegistry& registry = Registry();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  return registry.logs[path].num_solves++;
}

bool StockGoesFirst(const std::string& path) {
  LogRegistry& registry = Registry();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  return std::bitset<64>(registry.logs[path].num_comparisons++).count() % 2 == 1;
}

std::string LogLine(const SolveCall& call, std::int64_t number) {
  const SolveReport& report = *call.report;
  const SolveMode mode = call.solve_options.mode;
  const CrossCheckResult& result = *report.comparison;
  const bool solved_by_ours =
      result.compared || (!report.used_stock && report.fallback_reason.empty());
  const bool solved_by_stock = result.compared || report.used_stock;
  return JsonObject()
      .AddString("time", Now())
      .Add("process", static_cast<std::int64_t>(getpid()))
      .Add("solve", number)
      .AddString("mode", Name(mode))
      .Add("function_tolerance", call.options.function_tolerance)
      .AddRaw("sizes", Sizes(*call.summary))
      .AddRaw("structure", Structure(report, *call.summary))
      .AddRaw("ours", solved_by_ours ? OurOutcome(report, mode) : "null")
      .AddRaw("stock",
              solved_by_stock ? Outcome(result.stock, result.stock_seconds).Close() : "null")
      .AddRaw("difference",
              result.compared ? Differences(result, TolerancesFor(call.solve_options, call.options))
                              : "null")
      .AddString("first", Name(result.first))
      .AddString("kept", Name(result.kept))
      .AddString("fallback_reason", report.fallback_reason)
      .AddString("not_compared", result.compared ? "" : result.reason)
      .AddRaw("machine", Machine())
      .Close();
}

void AppendToLog(const std::string& path, const std::string& line) {
  const int file = open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
  if (file < 0) {
    ComplainOnce(path, std::strerror(errno));
    return;
  }
  const std::string text = line + "\n";
  const ssize_t written = write(file, text.data(), text.size());
  if (written != static_cast<ssize_t>(text.size())) {
    ComplainOnce(path, written < 0 ? std::strerror(errno) : "a line was cut short");
  }
  close(file);
}

}  // namespace inceres::internal
