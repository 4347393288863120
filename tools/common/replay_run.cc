#include "tools/common/replay_run.h"

#include <algorithm>
#include <chrono>
#include <cstddef>

namespace inceres::tools {
namespace {

Status Grow(const ReplayStep& step, ReplaySolver* solver, ReplaySide* side) {
  const auto start = std::chrono::steady_clock::now();
  Status status = solver->AddStep(step);
  side->growth_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (!status.ok()) {
    status.message = solver->Name() + ": " + status.message;
  }
  return status;
}

void Count(const ReplayStep& step, ReplayRow* row) {
  ++row->step;
  for (const ReplayVariable& variable : step.variables) {
    ++(IsLandmark(variable.kind) ? row->num_landmarks : row->num_frames);
  }
  row->num_factors += static_cast<int>(step.factors.size());
  row->closes_loop = step.closes_loop;
}

}  // namespace

std::optional<double> ReplayRow::RelativeCostExcess() const {
  if (!optimum_cost.has_value()) {
    return std::nullopt;
  }
  const double rounding = 1e-16 * std::max(ours.outcome.initial_cost, 0.0);
  const double optimum = std::max(*optimum_cost, rounding);
  return optimum > 0.0 ? (std::max(ours.cost, rounding) - optimum) / optimum : 0.0;
}

Status RunReplay(const ReplayScript& script, const ReplayRunOptions& options, ReplaySolver* ours, ReplaySolver* stock,
                 ReplayReference* judge, const std::function<void(const ReplayRow&)>& on_row, std::vector<ReplayRow>* rows) {
  std::size_t count = script.steps.size();
  if (options.max_steps > 0) {
    count = std::min(count, static_cast<std::size_t>(options.max_steps));
  }
  ReplayRow row;
  for (std::size_t i = 0; i < count; ++i) {
    const ReplayStep& step = script.steps[i];
    Count(step, &row);
    Status status = Grow(step, ours, &row.ours);
    status = status.ok() ? Grow(step, stock, &row.stock) : status;
    status = status.ok() ? judge->AddStep(step) : status;
    if (!status.ok()) {
      status.message = "step " + std::to_string(row.step) + ": " + status.message;
      return status;
    }
    const std::vector<double> start = ours->State();
    row.ours.outcome = ours->Solve();
    row.stock.outcome = stock->Solve();
    row.optimum_cost.reset();
    if (options.find_optimum) {
      const ReplayOutcome optimum = judge->MinimumFrom(start);
      if (optimum.usable) {
        row.optimum_cost = optimum.final_cost;
      }
    }
    row.stock.cost = judge->CostAt(stock->State());
    row.ours.cost = judge->CostAt(ours->State());
    on_row(row);
    rows->push_back(row);
  }
  return Status::Ok();
}

}  // namespace inceres::tools
