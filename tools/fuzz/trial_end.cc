// How and where a solve ended.
#include <algorithm>
#include <cmath>
#include <vector>

#include "src/base/formatted.h"
#include "tools/fuzz/trial_checks.h"

namespace inceres::fuzz {
namespace {

using internal::Formatted;

// A solver that has used up at least this many iterations, where stock needs less than a fifth of
// them, does not converge.
constexpr int kManyIterations = 50;
constexpr double kFewShare = 0.2;
// Where stock's own solvers go different ways, how far ours in exact mode may end from the minimum
// is a matter of luck too: up to so many function tolerances.
constexpr double kChaoticExcess = 1000.0;
constexpr double kRepetitionChance = 0.1;

}  // namespace

std::optional<Finding> Trial::Termination() {
  if (summary_.termination_type == ceres::FAILURE) {
    if (start_evaluates_ && !world_->HasFault() &&
        Stock().summary().termination_type != ceres::FAILURE) {
      return Finding{"failed", "FAILURE from a start that can be evaluated, where stock solves: " +
                                   summary_.message};
    }
    ++counts_->failures;
    return std::nullopt;
  }
  // What remembers need not ask for Jacobians.
  const bool start_will_do = solver_->follows_stock() ? start_evaluates_ : start_has_cost_;
  if (!start_will_do && Stock().summary().termination_type == ceres::FAILURE) {
    return Finding{"no_failure",
                   Formatted("%s from a start that cannot be evaluated: ",
                             ceres::TerminationTypeToString(summary_.termination_type)) +
                       summary_.message};
  }
  if (summary_.termination_type != ceres::NO_CONVERGENCE) {
    return std::nullopt;
  }
  ++counts_->not_converged;
  if (options_.max_num_iterations < kManyIterations || solver_->follows_stock() ||
      judges_ == Judges::kStock) {
    return std::nullopt;
  }
  return CheckLimit();
}

// Ours has used up its iterations, or has found no proof: is it for nothing, or behind stock?
std::optional<Finding> Trial::CheckLimit() {
  const ceres::Solver::Summary& stock = Stock().summary();
  if (!Stock().Converge(static_cast<int>(kFewShare * options_.max_num_iterations))) {
    return std::nullopt;
  }
  const Verdict verdict = Judge(world_, options_.function_tolerance);
  const Verdict of_stock = VerdictOn(Stock());
  const bool is_there = verdict.judged && !verdict.is_excess;
  const double as_good =
      is_there ? kExcessTolerances * options_.function_tolerance * verdict.cost : 0.0;
  // Where Jacobians cannot be had there is no verdict.
  const bool is_lower = verdict.judged && of_stock.judged ? verdict.cost < of_stock.cost - as_good
                                                          : summary_.final_cost < stock.final_cost;
  if (is_lower) {
    return std::nullopt;  // went on to where stock gave up, and not for nothing
  }
  if (!of_stock.judged || of_stock.is_excess) {
    ++counts_->creeping;  // stock has not come to a minimum either
    return std::nullopt;
  }
  if (is_there && static_cast<int>(summary_.iterations.size()) <= options_.max_num_iterations) {
    ++counts_->unproven;  // which is no more than said
    return std::nullopt;
  }
  return Finding{
      is_there ? "does_not_end" : "slow",
      Formatted(
          "no convergence in %d iterations, cost %.12g, plain LM goes to %.12g (tolerance %.2g); "
          "stock %.12g in %zu",
          options_.max_num_iterations, verdict.cost, verdict.best, options_.function_tolerance,
          of_stock.cost, stock.iterations.size())};
}

const StockTraces& Trial::Stock() {
  if (stock_ == nullptr) {
    stock_ = std::make_unique<StockTraces>(options_, start_, world_, dice_);
  }
  return *stock_;
}

std::optional<Finding> Trial::Trace() {
  if (!solver_->follows_stock()) {
    return std::nullopt;
  }
  if (!Stock().agree()) {
    ++counts_->traces_chaotic;
    return std::nullopt;
  }
  ++counts_->traces_compared;
  const std::optional<std::string> difference = Stock().Difference(summary_);
  return difference ? std::make_optional(Finding{"other_trace", *difference}) : std::nullopt;
}

// Again, with another number of threads, and sometimes with nothing kept of the structure.
std::optional<Finding> Trial::Repetition() {
  if (!solver_->repeats() || !dice_->Chance(kRepetitionChance)) {
    return std::nullopt;
  }
  const std::vector<double> values = world_->Values();
  ceres::Solver::Options other = options_;
  other.num_threads = options_.num_threads == 1 ? 2 : 1;
  const bool forgets = dice_->Chance(0.5);
  if (forgets) {
    solver_->Reset();
  }
  ceres::Solver::Summary again;
  world_->SetValues(start_);
  TheCallWatch().may_overlap = other.num_threads > 1;
  solver_->Solve(other, &world_->problem(), &again);
  TheCallWatch().may_overlap = false;
  const std::vector<double> values_again = world_->Values();
  world_->SetValues(values);
  if (values_again == values && again.termination_type == summary_.termination_type) {
    return std::nullopt;
  }
  double difference = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    difference = std::max(difference, std::abs(values[i] - values_again[i]));
  }
  return Finding{
      "not_repeated",
      Formatted(
          "with %d threads %s, cost %.17g, with %d threads %s, cost %.17g; values differ by %.3g%s",
          options_.num_threads, ceres::TerminationTypeToString(summary_.termination_type),
          summary_.final_cost, other.num_threads,
          ceres::TerminationTypeToString(again.termination_type), again.final_cost, difference,
          forgets ? ", the structure forgotten in between" : "")};
}

// Where plain LM goes from an end of stock's.
Verdict Trial::VerdictOn(const StockTraces& stock) {
  const std::vector<double> values = world_->Values();
  world_->SetValues(stock.end());
  const Verdict verdict = Judge(world_, options_.function_tolerance);
  world_->SetValues(values);
  return verdict;
}

std::optional<Finding> Trial::End() {
  if (summary_.termination_type != ceres::CONVERGENCE) {
    return std::nullopt;
  }
  const Verdict verdict = Judge(world_, options_.function_tolerance);
  counts_->judged += verdict.judged ? 1 : 0;
  if (verdict.judged && verdict.is_excess) {
    judge_ = verdict;
    return CheckExcess(verdict);
  }
  return std::nullopt;
}

std::optional<Finding> Trial::CheckExcess(const Verdict& ours) {
  if (ours.is_creeping) {
    ++counts_->creeping;
    counts_->worst_creeping_excess =
        std::max(counts_->worst_creeping_excess, ours.excess / options_.function_tolerance);
    return std::nullopt;
  }
  const Verdict stock = VerdictOn(Stock());
  if (world_->HasFault() && (!stock.judged || stock.is_excess)) {
    ++counts_->beside_faults;
    return std::nullopt;
  }
  const bool is_no_worse =
      !stock.judged || ours.cost - ours.best <= 2.0 * (stock.cost - stock.best);
  const bool chaotic = solver_->follows_stock() && !Stock().agree() &&
                       ours.excess < kChaoticExcess * options_.function_tolerance;
  if ((solver_->may_follow_stock() || Stock().EndedByLength()) && (chaotic || is_no_worse)) {
    ++counts_->as_stock;
    return std::nullopt;
  }
  const std::string kind = world_->HasFault() ? "excess_beside_fault"
                           : is_no_worse      ? "excess_as_stock"
                                              : "excess";
  const Verdict goes_on = VerdictOn(StockTraces(options_, world_->Values(), world_, dice_));
  const double gain = (ours.cost - goes_on.cost) / (options_.function_tolerance * ours.cost);
  if (judges_ == Judges::kStock && gain <= kExcessTolerances) {
    ++counts_->unseen_by_stock;
    return std::nullopt;
  }
  return Finding{
      kind,
      Formatted("%.3g tolerances above where plain LM goes, which gains ten in %d steps: %.12g, "
                "%.12g (tolerance "
                "%.2g, %zu iterations); stock "
                "ends at %.12g with an excess of %.2g tolerances after %zu iterations, and started "
                "where ours ends it gains %.2g; ",
                ours.excess / options_.function_tolerance, ours.steps, ours.cost, ours.best,
                options_.function_tolerance, summary_.iterations.size(), stock.cost,
                stock.excess / options_.function_tolerance, Stock().summary().iterations.size(),
                gain) +
          summary_.message};
}

}  // namespace inceres::fuzz
