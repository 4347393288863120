#include "tools/replay/replay_summary.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "tools/ab/statistics.h"

namespace inceres::tools {
namespace {

template <typename Seconds>
ReplayLatency LatencyOfSteps(const std::vector<const ReplaySide*>& steps, Seconds&& seconds) {
  std::vector<double> milliseconds;
  milliseconds.reserve(steps.size());
  for (const ReplaySide* step : steps) {
    milliseconds.push_back(1e3 * seconds(*step));
  }
  return LatencyOf(milliseconds);
}

void RaiseTo(std::optional<double>* largest, double value) {
  *largest = largest->has_value() ? std::max(**largest, value) : value;
}

// Each step's `rounding` is as of ReplayRow.
ReplaySideSummary SummarizeSide(const std::vector<const ReplaySide*>& steps,
                                const std::vector<double>& rounding) {
  ReplaySideSummary summary;
  summary.ms = LatencyOfSteps(steps, [](const ReplaySide& side) { return side.outcome.seconds; });
  summary.growth_ms =
      LatencyOfSteps(steps, [](const ReplaySide& side) { return side.growth_seconds; });
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const ReplayOutcome& outcome = steps[i]->outcome;
    if (!outcome.usable) {
      summary.failed.push_back(static_cast<int>(i) + 1);
      continue;
    }
    summary.unconverged += outcome.termination == "CONVERGENCE" ? 0 : 1;
    const double scale = std::max(std::fabs(steps[i]->cost), rounding[i]);
    if (scale > 0.0) {
      summary.max_report_error = std::max(summary.max_report_error,
                                          std::fabs(outcome.final_cost - steps[i]->cost) / scale);
    }
  }
  for (const ReplaySide* step : steps) {
    summary.iterations += step->outcome.iterations;
    for (const auto& [name, count] : step->outcome.work) {
      summary.invalid_steps += name == "invalid_steps" ? count : 0;
    }
  }
  return summary;
}

// What both sides have in common: who is lower, and the loops.
void Compare(const std::vector<ReplayRow>& rows, double tolerance, ReplaySummary* summary) {
  for (const ReplayRow& row : rows) {
    const double ours = row.ours.cost, stock = row.stock->cost;
    // A cost that cannot be evaluated is not lower than any; rounding is not a difference.
    const double margin =
        std::max(tolerance, 1e-14) * std::fabs(std::min(ours, stock)) + row.Rounding();
    summary->ours_lower +=
        ours + margin < stock || (std::isfinite(ours) && !std::isfinite(stock)) ? 1 : 0;
    summary->stock_lower +=
        stock + margin < ours || (std::isfinite(stock) && !std::isfinite(ours)) ? 1 : 0;
    if (row.closes_loop) {
      RaiseTo(&summary->worst_loop_ratio, row.ours.outcome.seconds / row.stock->outcome.seconds);
    }
  }
}

// Absent if no step was solved so.
std::optional<ReplayBesideBatch> CompareWithBatch(const std::vector<ReplayRow>& rows) {
  ReplayBesideBatch beside;
  double ours = 0.0, batch = 0.0;
  int num_within = 0, count = 0;
  for (const ReplayRow& row : rows) {
    if (!row.batch.has_value() || !row.batch->usable) {
      continue;
    }
    ++count;
    ours += row.ours.outcome.processor_seconds;
    batch += row.batch->processor_seconds;
    const double ratio = std::max(kShortestCompared, row.ours.outcome.processor_seconds) /
                         std::max(kShortestCompared, row.batch->processor_seconds);
    num_within += ratio <= kBatchSlack ? 1 : 0;
    beside.num_above_twice += ratio > 2.0 ? 1 : 0;
    if (ratio > beside.worst) {
      beside.worst = ratio;
      beside.worst_step = row.step;
    }
  }
  if (count == 0) {
    return std::nullopt;
  }
  beside.within = static_cast<double>(num_within) / count;
  beside.total = ours / batch;
  return beside;
}

}  // namespace

ReplayLatency LatencyOf(const std::vector<double>& milliseconds) {
  const Spread spread = Summarize(milliseconds);
  return {spread.median, Percentile(milliseconds, 0.95), spread.max,
          std::accumulate(milliseconds.begin(), milliseconds.end(), 0.0)};
}

ReplaySummary Summarize(const std::vector<ReplayRow>& rows, double tolerance) {
  ReplaySummary summary;
  summary.steps = static_cast<int>(rows.size());
  std::vector<const ReplaySide*> ours, stock;
  std::vector<double> rounding;
  for (const ReplayRow& row : rows) {
    ours.push_back(&row.ours);
    rounding.push_back(row.Rounding());
    if (row.stock.has_value()) {
      stock.push_back(&*row.stock);
    }
    if (const std::optional<double> excess = row.RelativeCostExcess()) {
      RaiseTo(&summary.max_relative_cost_excess, *excess);
      if (!(*excess <= tolerance)) {
        summary.in_excess.push_back(row.step);
      }
    }
  }
  summary.ours = SummarizeSide(ours, rounding);
  summary.beside_batch = CompareWithBatch(rows);
  if (!stock.empty()) {
    summary.stock = SummarizeSide(stock, rounding);
    summary.ratio_median = summary.ours.ms.median / summary.stock->ms.median;
    summary.ratio_total = summary.ours.ms.total / summary.stock->ms.total;
    Compare(rows, tolerance, &summary);
  }
  return summary;
}

}  // namespace inceres::tools
