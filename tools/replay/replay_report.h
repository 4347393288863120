#pragma once

#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/replay/replay_run.h"
#include "tools/replay/replay_summary.h"

namespace inceres::tools {

/// {"median", "p95", "max", "total"}
nlohmann::json ToJson(const ReplayLatency& latency);

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

/// "3, 5, 7-9": the first dozen ranges and how many steps there are in all.
std::string StepList(const std::vector<int>& steps);

/// The lines under the table.
std::string ReplaySummaryText(const ReplayContext& context, const ReplaySummary& summary);

/// The report for programs: {"steps", "ours_ms": {"median", "p95", "max", "total"}, "stock_ms":
/// {…}, "ratio_median", "ratio_total", "max_relative_cost_excess", "steps_in_excess": [numbers],
/// "worst_loop_ratio", "failed_steps": {"ours": how many, "stock"}, "ours_steps": {"failed":
/// [numbers], "unconverged", "iterations", "invalid_steps", "growth_ms": {"median", …}},
/// "stock_steps": {…}, …, "rows": [one object a step]}. What there is none of is null.
nlohmann::json ReplayJson(const ReplayContext& context, const ReplaySummary& summary,
                          const std::vector<ReplayRow>& rows);

/// {"step", "frames": [variable of each block row], "blocks": [[row, column], …] below the
/// diagonal, "changed_rows": […]}
nlohmann::json StructureJson(int step, const ReducedStructure& structure);

}  // namespace inceres::tools
