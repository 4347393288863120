#include "tools/replay/replay_report.h"

#include <cstddef>

#include "src/base/formatted.h"
#include "tools/command_line/json_values.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

constexpr std::size_t kListedRanges = 12;

nlohmann::json StepsJson(const ReplaySideSummary& side) {
  return {{"failed", side.failed},
          {"unconverged", side.unconverged},
          {"iterations", side.iterations},
          {"invalid_steps", side.invalid_steps},
          {"max_report_error", side.max_report_error},
          {"growth_ms", ToJson(side.growth_ms)}};
}

nlohmann::json ToJson(const ReplayBesideBatch& beside) {
  return {{"slack", kBatchSlack},
          {"within", beside.within},
          {"above_twice", beside.num_above_twice},
          {"worst", beside.worst},
          {"worst_step", beside.worst_step},
          {"total", beside.total}};
}

nlohmann::json ToJson(const ReplaySide& side) {
  return {{"ms", 1e3 * side.outcome.seconds},
          {"processor_ms", 1e3 * side.outcome.processor_seconds},
          {"growth_ms", 1e3 * side.growth_seconds},
          {"cost", side.cost},
          {"initial_cost", side.outcome.initial_cost},
          {"reported_cost", side.outcome.final_cost},
          {"iterations", side.outcome.iterations},
          {"usable", side.outcome.usable},
          {"termination", side.outcome.termination},
          {"message", side.outcome.message},
          {"work", JsonObject(side.outcome.work)}};
}

nlohmann::json ToJson(const ReplayRow& row) {
  return {{"step", row.step},
          {"frames", row.num_frames},
          {"landmarks", row.num_landmarks},
          {"factors", row.num_factors},
          {"closes_loop", row.closes_loop},
          {"ours", ToJson(row.ours)},
          {"stock", row.stock.has_value() ? ToJson(*row.stock) : nlohmann::json()},
          {"batch_processor_ms", row.batch.has_value()
                                     ? nlohmann::json(1e3 * row.batch->processor_seconds)
                                     : nlohmann::json()},
          {"batch_iterations",
           row.batch.has_value() ? nlohmann::json(row.batch->iterations) : nlohmann::json()},
          {"batch_cost",
           row.batch.has_value() ? nlohmann::json(row.batch->final_cost) : nlohmann::json()},
          {"optimum_cost", OrNull(row.optimum_cost)},
          {"relative_cost_excess", OrNull(row.RelativeCostExcess())}};
}

void AppendSide(std::string* text, const char* name, const ReplaySideSummary& side) {
  if (!side.failed.empty()) {
    *text += Formatted("%s: %zu steps whose solve failed: %s\n", name, side.failed.size(),
                       StepList(side.failed).c_str());
  }
  if (side.unconverged > 0) {
    *text += Formatted("%s: %d steps ended before they converged\n", name, side.unconverged);
  }
  if (side.invalid_steps > 0) {
    *text += Formatted("%s: %lld iterations of %d whose linear solve or evaluation failed\n", name,
                       static_cast<long long>(side.invalid_steps), side.iterations);
  }
  if (side.max_report_error > 1e-6) {
    *text += Formatted("%s: reports a cost that is not its state's: off by up to %.1e, relative\n",
                       name, side.max_report_error);
  }
}

void AppendTimes(std::string* text, const char* name, const ReplayLatency& latency) {
  *text += Formatted("%-30s %9.2f %9.2f %9.2f %10.1f\n", name, latency.median, latency.p95,
                     latency.max, latency.total);
}

}  // namespace

nlohmann::json ToJson(const ReplayLatency& latency) {
  return {{"median", latency.median},
          {"p95", latency.p95},
          {"max", latency.max},
          {"total", latency.total}};
}

std::string ReplayTableHeader() {
  return "  step frames landmarks factors |  ours ms iter            cost | stock ms iter          "
         "  cost | excess\n";
}

std::string ReplayTableLine(const ReplayRow& row) {
  const ReplayOutcome& ours = row.ours.outcome;
  std::string line;
  line +=
      Formatted("%6d %6d %9d %7d | %8.2f %4d %15.8e |", row.step, row.num_frames, row.num_landmarks,
                row.num_factors, 1e3 * ours.seconds, ours.iterations, row.ours.cost);
  if (row.stock.has_value()) {
    line += Formatted(" %8.2f %4d %15.8e |", 1e3 * row.stock->outcome.seconds,
                      row.stock->outcome.iterations, row.stock->cost);
  } else {
    line += Formatted(" %8s %4s %15s |", "-", "-", "-");
  }
  if (const std::optional<double> excess = row.RelativeCostExcess()) {
    line += Formatted(" %+.1e", *excess);
  }
  line += row.closes_loop ? "  loop" : "";
  line += ours.usable ? "" : "  ours failed: " + ours.message;
  if (row.stock.has_value() && !row.stock->outcome.usable) {
    line += "  stock failed: " + row.stock->outcome.message;
  }
  return line + "\n";
}

std::string StepList(const std::vector<int>& steps) {
  std::string text;
  std::size_t ranges = 0;
  for (std::size_t i = 0; i < steps.size(); ++ranges) {
    if (ranges == kListedRanges) {
      return text + ", ... (" + std::to_string(steps.size()) + " in all)";
    }
    std::size_t last = i;
    while (last + 1 < steps.size() && steps[last + 1] == steps[last] + 1) {
      ++last;
    }
    text += (i == 0 ? "" : ", ") + std::to_string(steps[i]) +
            (last > i ? "-" + std::to_string(steps[last]) : "");
    i = last + 1;
  }
  return text;
}

std::string ReplaySummaryText(const ReplayContext& context, const ReplaySummary& summary) {
  std::string text;
  text += Formatted("\n%d steps, %d threads, ms a step    median       p95       max      total\n",
                    summary.steps, context.threads);
  AppendTimes(&text, "ours", summary.ours.ms);
  if (summary.stock.has_value()) {
    AppendTimes(&text, "stock", summary.stock->ms);
    text += Formatted("%-30s %9.4f %30.4f\n", "ours / stock", *summary.ratio_median,
                      *summary.ratio_total);
  }
  AppendTimes(&text, "ours, adding the step", summary.ours.growth_ms);
  if (summary.stock.has_value()) {
    AppendTimes(&text, "stock, adding the step", summary.stock->growth_ms);
  }
  if (summary.worst_loop_ratio.has_value()) {
    text +=
        Formatted("ours / stock, worst step that closes a loop: %.4f\n", *summary.worst_loop_ratio);
  }
  if (summary.beside_batch.has_value()) {
    const ReplayBesideBatch& beside = *summary.beside_batch;
    text += Formatted(
        "a batch solve from the same values: %.2f %% of steps take at most %g times as "
        "long, %d more than twice, the worst (%d) %.2f times, all %.3f times\n",
        100.0 * beside.within, kBatchSlack, beside.num_above_twice, beside.worst_step, beside.worst,
        beside.total);
  }
  if (summary.max_relative_cost_excess.has_value()) {
    text += Formatted("largest relative excess of our cost over the batch optimum: %.2e\n",
                      *summary.max_relative_cost_excess);
  }
  if (!summary.in_excess.empty()) {
    text += Formatted("steps whose excess is above the tolerance: %s\n",
                      StepList(summary.in_excess).c_str());
  }
  if (summary.ours_lower + summary.stock_lower > 0) {
    text +=
        Formatted("steps that left one side lower by more than the tolerance: ours %d, stock %d\n",
                  summary.ours_lower, summary.stock_lower);
  }
  AppendSide(&text, "ours", summary.ours);
  if (summary.stock.has_value()) {
    AppendSide(&text, "stock", *summary.stock);
  }
  return text + "ours:  " + context.ours + "\n" +
         (summary.stock.has_value() ? "stock: " + context.stock + "\n" : "");
}

nlohmann::json ReplayJson(const ReplayContext& context, const ReplaySummary& summary,
                          const std::vector<ReplayRow>& rows) {
  nlohmann::json json_rows = nlohmann::json::array();
  for (const ReplayRow& row : rows) {
    json_rows.push_back(ToJson(row));
  }
  const bool both = summary.stock.has_value();
  const nlohmann::json null;
  return {{"problem", context.problem},
          {"description", context.description},
          {"ours", context.ours},
          {"stock", both ? nlohmann::json(context.stock) : null},
          {"threads", context.threads},
          {"seed", context.seed},
          {"function_tolerance", context.function_tolerance},
          {"parameter_tolerance", context.parameter_tolerance},
          {"steps", summary.steps},
          {"ours_ms", ToJson(summary.ours.ms)},
          {"stock_ms", both ? ToJson(summary.stock->ms) : null},
          {"ratio_median", OrNull(summary.ratio_median)},
          {"ratio_total", OrNull(summary.ratio_total)},
          {"max_relative_cost_excess", OrNull(summary.max_relative_cost_excess)},
          {"steps_in_excess", summary.in_excess},
          {"worst_loop_ratio", OrNull(summary.worst_loop_ratio)},
          {"beside_batch", summary.beside_batch.has_value() ? ToJson(*summary.beside_batch) : null},
          {"lower", {{"ours", summary.ours_lower}, {"stock", summary.stock_lower}}},
          {"failed_steps",
           {{"ours", summary.ours.failed.size()},
            {"stock", both ? nlohmann::json(summary.stock->failed.size()) : null}}},
          {"ours_steps", StepsJson(summary.ours)},
          {"stock_steps", both ? StepsJson(*summary.stock) : null},
          {"environment", JsonObject(context.environment)},
          {"rows", json_rows}};
}

nlohmann::json StructureJson(int step, const ReducedStructure& structure) {
  nlohmann::json blocks = nlohmann::json::array();
  for (const ReducedStructure::Block& block : structure.blocks) {
    blocks.push_back({block.row, block.column});
  }
  nlohmann::json changed_rows = nlohmann::json::array();
  for (std::size_t row = 0; row < structure.changed.size(); ++row) {
    if (structure.changed[row]) {
      changed_rows.push_back(row);
    }
  }
  return {{"step", step},
          {"frames", structure.frames},
          {"blocks", blocks},
          {"changed_rows", changed_rows}};
}

}  // namespace inceres::tools
