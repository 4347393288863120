#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/common/replay_run.h"

namespace inceres::tools {

/// Milliseconds of one side's solves over the steps of a replay.
struct ReplayLatency {
  double median = 0.0;
  double p95 = 0.0;  ///< the smallest latency that 95 % of the steps do not exceed
  double max = 0.0;
  double total = 0.0;
};

/// A replay in a few numbers.
struct ReplaySummary {
  int steps = 0;
  ReplayLatency ours;
  ReplayLatency stock;
  double ratio_median = 0.0;  ///< our median over stock's
  double ratio_total = 0.0;   ///< our total over stock's
  int failed_ours = 0;        ///< steps whose solve was not usable
  int failed_stock = 0;
  std::optional<double> max_relative_cost_excess;  ///< of our costs over the optimum's; absent if no step has one
  std::optional<double> worst_loop_ratio;          ///< largest ratio of latencies over the steps that close a loop
};

/// Requires one row or more.
ReplaySummary Summarize(const std::vector<ReplayRow>& rows);

/// The header of the table and a row's line, for people.
std::string ReplayTableHeader();
std::string ReplayTableLine(const ReplayRow& row);

/// What the report says besides the measurements.
struct ReplayContext {
  std::string problem;
  std::string description;
  std::string ours;
  std::string stock;
  int threads = 1;
  unsigned seed = 1;
  double function_tolerance = 0.0;
  double parameter_tolerance = 0.0;
  std::vector<std::pair<std::string, std::string>> environment;
};

/// The lines under the table.
std::string ReplaySummaryText(const ReplayContext& context, const ReplaySummary& summary);

/// The report for programs: {"steps", "ours_ms": {"median", "p95", "max", "total"}, "stock_ms": {…}, "ratio_median",
/// "ratio_total", "max_relative_cost_excess" (null without), "worst_loop_ratio" (null without), "failed_steps": {"ours",
/// "stock"}, …, "rows": [one object a step]}.
nlohmann::json ReplayJson(const ReplayContext& context, const ReplaySummary& summary, const std::vector<ReplayRow>& rows);

}  // namespace inceres::tools
