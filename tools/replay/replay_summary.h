#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "tools/replay/replay_run.h"

namespace inceres::tools {

/// Milliseconds of one side's solves over the steps of a replay.
struct ReplayLatency {
  double median = 0.0;
  double p95 = 0.0;  ///< the smallest latency that 95 % of the steps do not exceed
  double max = 0.0;
  double total = 0.0;
};

/// Of solves that took so long, one or more.
ReplayLatency LatencyOf(const std::vector<double>& milliseconds);

/// How one side got through a replay.
struct ReplaySideSummary {
  ReplayLatency ms;
  ReplayLatency growth_ms;         ///< of adding the steps, apart from the solves
  std::vector<int> failed;         ///< steps whose solve was not usable
  int unconverged = 0;             ///< usable, but ended by the limit of iterations
  std::int64_t invalid_steps = 0;  ///< iterations whose linear solve failed
  int iterations = 0;              ///< of all steps
  /// largest relative difference between the cost it reports and that of its state
  double max_report_error = 0.0;
};

/// Our steps against solves of the same graphs from the same values by who does not remember, in
/// processor time. Steps below kShortestCompared of both are not told apart.
struct ReplayBesideBatch {
  double within = 0.0;      ///< the share of all steps that take at most kBatchSlack times as long
  int num_above_twice = 0;  ///< steps that take more than twice as long
  double worst = 0.0;       ///< the largest ratio of times
  int worst_step = 0;
  double total = 0.0;  ///< our total over that of those solves
};
inline constexpr double kBatchSlack = 1.2;
inline constexpr double kShortestCompared = 1e-4;  ///< seconds

/// A replay in a few numbers.
struct ReplaySummary {
  int steps = 0;
  ReplaySideSummary ours;
  std::optional<ReplaySideSummary> stock;  ///< absent, like the ratios, if stock did not play
  std::optional<double> ratio_median;      ///< our median over stock's
  std::optional<double> ratio_total;       ///< our total over stock's
  int ours_lower = 0;   ///< steps after which our cost was lower by more than the tolerance
  int stock_lower = 0;  ///< steps after which stock's was
  /// of our costs over the optimum's; absent if no step has one
  std::optional<double> max_relative_cost_excess;
  /// steps whose excess is above the tolerance: not there yet, or another basin
  std::vector<int> in_excess;
  std::optional<ReplayBesideBatch> beside_batch;
  /// largest ratio of latencies over the steps that close a loop
  std::optional<double> worst_loop_ratio;
};

/// Costs that differ by less than `tolerance`, relative, count as equal. Requires one row or more.
ReplaySummary Summarize(const std::vector<ReplayRow>& rows, double tolerance);

}  // namespace inceres::tools
