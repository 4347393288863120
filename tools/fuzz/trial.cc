#include "tools/fuzz/trial.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "src/base/formatted.h"
#include "tools/fuzz/trial_checks.h"

namespace inceres::fuzz {
namespace {

using internal::Formatted;

// Final costs and initial ones are those of the memory, relative.
constexpr double kSameCost = 1e-9;

std::string IterationsOf(const char* whose, const ceres::Solver::Summary& summary) {
  std::string lines = Formatted("  %s, %s\n", whose, summary.message.c_str());
  for (const ceres::IterationSummary& i : summary.iterations) {
    lines +=
        Formatted("  %4d%s cost %.14g change %.3g ratio %.3g gradient %.2g step %.2g radius %.2g\n",
                  i.iteration, i.step_is_successful ? " " : "!", i.cost, i.cost_change,
                  i.relative_decrease, i.gradient_max_norm, i.step_norm, i.trust_region_radius);
  }
  return lines;
}

std::string StepsOf(const Verdict& judge, double tolerance) {
  if (judge.costs.empty()) {
    return "";
  }
  std::string lines = "  judge, gains in tolerances:";
  for (std::size_t i = 1; i < judge.costs.size(); ++i) {
    lines +=
        Formatted(" %.2g", (judge.costs[i - 1] - judge.costs[i]) / (tolerance * judge.costs[i]));
  }
  lines += "\n  promised there with dampings of 1e-4, 1e-6 ...:";
  for (const double promise : judge.promises) {
    lines += Formatted(" %.2g", promise / (tolerance * judge.best));
  }
  return lines + "\n";
}

}  // namespace

void Trial::LookAtStart() {
  std::vector<double> gradient;
  ceres::CRSMatrix jacobian;
  const auto finite = [](double value) { return std::isfinite(value); };
  start_has_cost_ = world_->problem().Evaluate({}, &start_cost_, nullptr, nullptr, nullptr) &&
                    finite(start_cost_);
  start_evaluates_ = start_has_cost_ &&
                     world_->problem().Evaluate({}, nullptr, nullptr, &gradient, &jacobian) &&

                     std::all_of(gradient.begin(), gradient.end(), finite) &&
                     std::all_of(jacobian.values.begin(), jacobian.values.end(), finite);
}

// By how much sums of one cost in other orders may differ.
double Trial::Rounding(double cost) const {
  const double magnitude = world_->Magnitude();
  return 1e-26 * magnitude + 1e-13 * std::sqrt(magnitude * std::abs(cost));
}

std::optional<Finding> Trial::Run() {
  LookAtStart();
  CallWatch& watch = TheCallWatch();
  watch.calls_too_late = 0;
  watch.overlapping_calls = 0;
  watch.may_overlap = options_.num_threads > 1;
  solver_->Solve(options_, &world_->problem(), &summary_);
  watch.may_call = false;
  watch.may_overlap = false;
  ++counts_->solves;
  counts_->handed_to_stock += solver_->used_stock() ? 1 : 0;
  constexpr Check kWithoutCalls[] = {&Trial::Memory, &Trial::Bounds, &Trial::Calls};
  constexpr Check kWithCalls[] = {&Trial::Costs, &Trial::Termination, &Trial::Trace,
                                  &Trial::Repetition, &Trial::End};
  std::optional<Finding> finding;
  for (const Check check : kWithoutCalls) {
    finding = finding ? finding : (this->*check)();
  }
  watch.may_call = true;
  for (const Check check : kWithCalls) {
    finding = finding || solver_->used_stock() ? finding : (this->*check)();
  }
  if (finding) {
    finding->iterations = IterationsOf("ours", summary_) +
                          StepsOf(judge_, options_.function_tolerance) +
                          (stock_ != nullptr ? IterationsOf("stock", stock_->summary()) : "");
  }
  return finding;
}

std::optional<Finding> Trial::Calls() {
  const CallWatch& watch = TheCallWatch();
  if (watch.calls_too_late > 0 || watch.active > 0) {
    return Finding{
        "called_after_return",
        Formatted("%ld calls of cost functions after Solve returned", watch.calls_too_late.load())};
  }
  if (watch.overlapping_calls > 0) {
    return Finding{"called_concurrently", Formatted("%ld calls at a time with num_threads 1",
                                                    watch.overlapping_calls.load())};
  }
  return std::nullopt;
}

std::optional<Finding> Trial::Memory() {
  const std::vector<double> values = world_->Values();
  const bool failed = summary_.termination_type == ceres::FAILURE;
  std::size_t i = 0;
  for (std::size_t b = 0; b < world_->blocks().size(); ++b) {
    const World::Block& block = *world_->blocks()[b];
    for (int j = 0; j < block.size; ++j, ++i) {
      if (!std::isfinite(values[i])) {
        return Finding{"not_a_number", Formatted("block %zu has %g", b, values[i])};
      }
      if (values[i] != start_[i] && (failed || block.constant)) {
        return Finding{failed ? "failure_moved_values" : "constant_moved",
                       Formatted("block %zu: %.17g became %.17g", b, start_[i], values[i])};
      }
    }
  }
  return std::nullopt;
}

std::optional<Finding> Trial::Bounds() {
  for (const auto& block : world_->blocks()) {
    for (int j = 0; j < block->size && summary_.termination_type != ceres::FAILURE; ++j) {
      if (block->x[j] < world_->problem().GetParameterLowerBound(block->x, j) ||
          block->x[j] > world_->problem().GetParameterUpperBound(block->x, j)) {
        return Finding{"beyond_bound", Formatted("a value of %.17g", block->x[j])};
      }
    }
  }
  return std::nullopt;
}

// Stock's final cost is the least of all iterations, that of a refused step included that gained,
// but too little for its length: memory then has the least accepted one. And where the start cannot
// be evaluated, what stock says.
bool Trial::SaysAsStock(double cost, double rounding) {
  double accepted = std::numeric_limits<double>::infinity();
  for (const ceres::IterationSummary& iteration : summary_.iterations) {
    accepted = iteration.step_is_successful || iteration.iteration == 0
                   ? std::min(accepted, iteration.cost)
                   : accepted;
  }
  return std::abs(cost - accepted) <= kSameCost * std::abs(cost) + rounding ||
         (!start_evaluates_ && Stock().summary().termination_type == summary_.termination_type);
}

std::optional<Finding> Trial::Costs() {
  if (summary_.termination_type == ceres::FAILURE) {
    return std::nullopt;
  }
  double cost = 0.0;
  const bool evaluated = world_->problem().Evaluate({}, &cost, nullptr, nullptr, nullptr);
  const double rounding = Rounding(cost);
  if (!evaluated || !std::isfinite(summary_.final_cost) ||
      std::abs(cost - summary_.final_cost) > kSameCost * std::abs(cost) + rounding) {
    if (solver_->may_follow_stock() && SaysAsStock(cost, rounding)) {
      return std::nullopt;
    }
    return Finding{"wrong_final_cost",
                   Formatted("the summary says %s with %.17g, memory has %.17g%s",
                             ceres::TerminationTypeToString(summary_.termination_type),
                             summary_.final_cost, cost, evaluated ? "" : " (cannot be evaluated)")};
  }
  if (!options_.use_nonmonotonic_steps && start_has_cost_ &&
      cost > start_cost_ * (1.0 + kSameCost) + rounding) {
    return Finding{"went_up", Formatted("from %.17g to %.17g", start_cost_, cost)};
  }
  return std::nullopt;
}

std::optional<Finding> SolveAndCheck(const ceres::Solver::Options& options, Judges judges,
                                     World* world, SolverUnderTest* solver, Dice* dice,
                                     Counts* counts) {
  return Trial(options, judges, world, solver, dice, counts).Run();
}

}  // namespace inceres::fuzz
