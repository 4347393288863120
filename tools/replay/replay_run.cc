#include "tools/replay/replay_run.h"

#include <algorithm>
#include <chrono>
#include <cstddef>

namespace inceres::tools {
namespace {

Status Grow(const ReplayStep& step, ReplaySolver* solver, ReplaySide* side) {
  const auto start = std::chrono::steady_clock::now();
  Status status = solver->AddStep(step);
  side->growth_seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
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

// `start`, if not null, is where ours began the step: the optimum is sought from there.
void Judge(const std::vector<double>* start, const ReplaySolver& ours, const ReplaySolver* stock,
           ReplayReference* judge, ReplayRow* row) {
  row->optimum_cost.reset();
  if (judge == nullptr) {
    row->ours.cost = row->ours.outcome.final_cost;
    return;
  }
  if (start != nullptr) {
    const ReplayOutcome optimum = judge->MinimumFrom(*start);
    if (optimum.usable) {
      row->optimum_cost = optimum.final_cost;
    }
  }
  if (stock != nullptr) {
    row->stock->cost = judge->CostAt(stock->State());
  }
  row->ours.cost = judge->CostAt(ours.State());
}

}  // namespace

double ReplayRow::Rounding() const {
  return std::max(1e-16 * ours.outcome.initial_cost, 1e-20 * num_factors);
}

std::optional<double> ReplayRow::RelativeCostExcess() const {
  if (!optimum_cost.has_value()) {
    return std::nullopt;
  }
  const double optimum = std::max(*optimum_cost, Rounding());
  return optimum > 0.0 ? (std::max(ours.cost, Rounding()) - optimum) / optimum : 0.0;
}

Status RunReplay(const ReplayScript& script, const ReplayRunOptions& options, ReplaySolver* ours,
                 ReplaySolver* stock, ReplayReference* judge,
                 const std::function<void(const ReplayRow&)>& on_row,
                 std::vector<ReplayRow>* rows) {
  std::size_t count = script.steps.size();
  if (options.max_steps > 0) {
    count = std::min(count, static_cast<std::size_t>(options.max_steps));
  }
  ReplayRow row;
  if (stock != nullptr) {
    row.stock.emplace();
  }
  for (std::size_t i = 0; i < count; ++i) {
    const ReplayStep& step = script.steps[i];
    Count(step, &row);
    Status status = Grow(step, ours, &row.ours);
    status = status.ok() && stock != nullptr ? Grow(step, stock, &*row.stock) : status;
    status = status.ok() ? judge->AddStep(step) : status;
    if (!status.ok()) {
      status.message = "step " + std::to_string(row.step) + ": " + status.message;
      return status;
    }
    const std::vector<double> start = options.find_optimum ? ours->State() : std::vector<double>();
    row.ours.outcome = ours->Solve();
    if (stock != nullptr) {
      row.stock->outcome = stock->Solve();
    }
    const bool look =
        stock != nullptr || options.find_optimum || (options.look_at_last && i + 1 == count);
    Judge(options.find_optimum ? &start : nullptr, *ours, stock, look ? judge : nullptr, &row);
    on_row(row);
    rows->push_back(row);
  }
  return Status::Ok();
}

}  // namespace inceres::tools
