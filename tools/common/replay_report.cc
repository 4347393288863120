#include "tools/common/replay_report.h"

#include <algorithm>
#include <cstdio>
#include <numeric>

#include "tools/common/statistics.h"
#include "tools/common/svg_text.h"

namespace inceres::tools {
namespace {

ReplayLatency Latency(const std::vector<ReplayRow>& rows, ReplaySide ReplayRow::*side) {
  std::vector<double> milliseconds;
  milliseconds.reserve(rows.size());
  for (const ReplayRow& row : rows) {
    milliseconds.push_back(1e3 * (row.*side).outcome.seconds);
  }
  const Spread spread = Summarize(milliseconds);
  return {spread.median, Percentile(milliseconds, 0.95), spread.max,
          std::accumulate(milliseconds.begin(), milliseconds.end(), 0.0)};
}

void RaiseTo(std::optional<double>* largest, double value) {
  *largest = largest->has_value() ? std::max(**largest, value) : value;
}

nlohmann::json OrNull(const std::optional<double>& value) {
  return value.has_value() ? nlohmann::json(*value) : nlohmann::json();
}

nlohmann::json ToJson(const ReplayLatency& latency) {
  return {{"median", latency.median}, {"p95", latency.p95}, {"max", latency.max}, {"total", latency.total}};
}

nlohmann::json ToJson(const ReplaySide& side) {
  nlohmann::json work = nlohmann::json::object();
  for (const auto& [name, count] : side.outcome.work) {
    work[name] = count;
  }
  return {{"ms", 1e3 * side.outcome.seconds},
          {"growth_ms", 1e3 * side.growth_seconds},
          {"cost", side.cost},
          {"initial_cost", side.outcome.initial_cost},
          {"reported_cost", side.outcome.final_cost},
          {"iterations", side.outcome.iterations},
          {"usable", side.outcome.usable},
          {"termination", side.outcome.termination},
          {"message", side.outcome.message},
          {"work", work}};
}

nlohmann::json ToJson(const ReplayRow& row) {
  return {{"step", row.step},
          {"frames", row.num_frames},
          {"landmarks", row.num_landmarks},
          {"factors", row.num_factors},
          {"closes_loop", row.closes_loop},
          {"ours", ToJson(row.ours)},
          {"stock", ToJson(row.stock)},
          {"optimum_cost", OrNull(row.optimum_cost)},
          {"relative_cost_excess", OrNull(row.RelativeCostExcess())}};
}

}  // namespace

ReplaySummary Summarize(const std::vector<ReplayRow>& rows) {
  ReplaySummary summary;
  summary.steps = static_cast<int>(rows.size());
  summary.ours = Latency(rows, &ReplayRow::ours);
  summary.stock = Latency(rows, &ReplayRow::stock);
  summary.ratio_median = summary.ours.median / summary.stock.median;
  summary.ratio_total = summary.ours.total / summary.stock.total;
  for (const ReplayRow& row : rows) {
    summary.failed_ours += row.ours.outcome.usable ? 0 : 1;
    summary.failed_stock += row.stock.outcome.usable ? 0 : 1;
    if (const std::optional<double> excess = row.RelativeCostExcess()) {
      RaiseTo(&summary.max_relative_cost_excess, *excess);
    }
    if (row.closes_loop) {
      RaiseTo(&summary.worst_loop_ratio, row.ours.outcome.seconds / row.stock.outcome.seconds);
    }
  }
  return summary;
}

std::string ReplayTableHeader() {
  return "  step frames landmarks factors |  ours ms iter            cost | stock ms iter            cost | excess\n";
}

std::string ReplayTableLine(const ReplayRow& row) {
  const ReplayOutcome& ours = row.ours.outcome;
  const ReplayOutcome& stock = row.stock.outcome;
  std::string line;
  AppendFormat(&line, "%6d %6d %9d %7d | %8.2f %4d %15.8e | %8.2f %4d %15.8e |", row.step, row.num_frames, row.num_landmarks,
               row.num_factors, 1e3 * ours.seconds, ours.iterations, row.ours.cost, 1e3 * stock.seconds, stock.iterations,
               row.stock.cost);
  if (const std::optional<double> excess = row.RelativeCostExcess()) {
    AppendFormat(&line, " %+.1e", *excess);
  }
  line += row.closes_loop ? "  loop" : "";
  for (const auto& [side, outcome] : {std::pair("ours", &ours), std::pair("stock", &stock)}) {
    if (!outcome->usable) {
      line += std::string("  ") + side + " failed: " + outcome->message;
    }
  }
  return line + "\n";
}

std::string ReplaySummaryText(const ReplayContext& context, const ReplaySummary& summary) {
  std::string text;
  AppendFormat(&text, "\n%d steps, %d threads, ms a step    median       p95       max      total\n", summary.steps,
               context.threads);
  for (const auto& [name, latency] : {std::pair("ours", &summary.ours), std::pair("stock", &summary.stock)}) {
    AppendFormat(&text, "%-30s %9.2f %9.2f %9.2f %10.1f\n", name, latency->median, latency->p95, latency->max, latency->total);
  }
  AppendFormat(&text, "%-30s %9.4f %30.4f\n", "ours / stock", summary.ratio_median, summary.ratio_total);
  if (summary.worst_loop_ratio.has_value()) {
    AppendFormat(&text, "ours / stock, worst step that closes a loop: %.4f\n", *summary.worst_loop_ratio);
  }
  if (summary.max_relative_cost_excess.has_value()) {
    AppendFormat(&text, "largest relative excess of our cost over the batch optimum: %.2e\n", *summary.max_relative_cost_excess);
  }
  if (summary.failed_ours + summary.failed_stock > 0) {
    AppendFormat(&text, "steps whose solve failed: ours %d, stock %d\n", summary.failed_ours, summary.failed_stock);
  }
  return text + "ours:  " + context.ours + "\nstock: " + context.stock + "\n";
}

nlohmann::json ReplayJson(const ReplayContext& context, const ReplaySummary& summary, const std::vector<ReplayRow>& rows) {
  nlohmann::json environment = nlohmann::json::object();
  for (const auto& [name, value] : context.environment) {
    environment[name] = value;
  }
  nlohmann::json json_rows = nlohmann::json::array();
  for (const ReplayRow& row : rows) {
    json_rows.push_back(ToJson(row));
  }
  return {{"problem", context.problem},
          {"description", context.description},
          {"ours", context.ours},
          {"stock", context.stock},
          {"threads", context.threads},
          {"seed", context.seed},
          {"function_tolerance", context.function_tolerance},
          {"parameter_tolerance", context.parameter_tolerance},
          {"steps", summary.steps},
          {"ours_ms", ToJson(summary.ours)},
          {"stock_ms", ToJson(summary.stock)},
          {"ratio_median", summary.ratio_median},
          {"ratio_total", summary.ratio_total},
          {"max_relative_cost_excess", OrNull(summary.max_relative_cost_excess)},
          {"worst_loop_ratio", OrNull(summary.worst_loop_ratio)},
          {"failed_steps", {{"ours", summary.failed_ours}, {"stock", summary.failed_stock}}},
          {"environment", environment},
          {"rows", json_rows}};
}

}  // namespace inceres::tools
