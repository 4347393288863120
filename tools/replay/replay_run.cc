#include "tools/replay/replay_run.h"

#include <algorithm>
#include <cstddef>
#include <ctime>

#include "src/base/stopwatch.h"

namespace inceres::tools {
namespace {

Status Grow(const ReplayStep& step, ReplaySolver* solver, ReplaySide* side) {
  Status status;
  side->growth_seconds = internal::SecondsOf([&] { status = solver->AddStep(step); });
  if (!status.ok()) {
    status.message = solver->Name() + ": " + status.message;
  }
  return status;
}

ReplayOutcome Solve(ReplaySolver* solver) {
  const std::clock_t start = std::clock();
  ReplayOutcome outcome = solver->Solve();
  outcome.processor_seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  return outcome;
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

// Of n steps with c checkpoints: ⌈n/c⌉, ⌈2n/c⌉, …, n.
bool FindsOptimumAfter(std::size_t step, std::size_t num_steps, const ReplayRunOptions& options) {
  const auto checkpoints = static_cast<std::size_t>(options.checkpoints);
  return options.find_optimum && (checkpoints == 0 || step * checkpoints / num_steps !=
                                                          (step - 1) * checkpoints / num_steps);
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
                 ReplaySolver* stock, ReplaySolver* batch, ReplayReference* judge,
                 const std::function<void(const ReplayRow&)>& on_row,
                 std::vector<ReplayRow>* rows) {
  const std::size_t count = NumSteps(script, options.max_steps);
  ReplayRow row;
  if (stock != nullptr) {
    row.stock.emplace();
  }
  for (std::size_t i = 0; i < count; ++i) {
    const ReplayStep& step = script.steps[i];
    Count(step, &row);
    Status status = Grow(step, ours, &row.ours);
    status = status.ok() && stock != nullptr ? Grow(step, stock, &*row.stock) : status;
    status = status.ok() && batch != nullptr ? batch->AddStep(step) : status;
    status = status.ok() ? judge->AddStep(step) : status;
    if (!status.ok()) {
      status.message = "step " + std::to_string(row.step) + ": " + status.message;
      return status;
    }
    const bool find_optimum = FindsOptimumAfter(row.step, count, options);
    const std::vector<double> start =
        find_optimum || batch != nullptr ? ours->State() : std::vector<double>();
    row.ours.outcome = Solve(ours);
    if (batch != nullptr && batch->StartFrom(start)) {
      row.batch = Solve(batch);
    }
    if (stock != nullptr) {
      row.stock->outcome = stock->Solve();
    }
    const bool look = stock != nullptr || find_optimum || (options.look_at_last && i + 1 == count);
    Judge(find_optimum ? &start : nullptr, *ours, stock, look ? judge : nullptr, &row);
    on_row(row);
    rows->push_back(row);
  }
  return Status::Ok();
}

}  // namespace inceres::tools
