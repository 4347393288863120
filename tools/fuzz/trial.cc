#include "tools/fuzz/trial.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <limits>
#include <vector>

#include "tools/fuzz/trace.h"

namespace inceres::fuzz {
namespace {

// Final costs and initial ones are those of the memory, relative.
constexpr double kSameCost = 1e-9;
// A solver that has used up at least this many iterations, where stock needs less than a fifth of them, does not converge.
constexpr int kManyIterations = 50;
constexpr double kFewShare = 0.2;
// Where stock's own solvers go different ways, how far ours in exact mode may end from the minimum is a matter of luck too: up to
// so many function tolerances.
constexpr double kChaoticExcess = 1000.0;
constexpr double kRepetitionChance = 0.1;

__attribute__((format(printf, 1, 2))) std::string Text(const char* format, ...) {
  char text[400];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return text;
}

class Trial {
 public:
  Trial(const ceres::Solver::Options& options, World* world, SolverUnderTest* solver, Dice* dice, Counts* counts)
      : options_(options), world_(world), solver_(solver), dice_(dice), counts_(counts), start_(world->Values()) {}

  std::optional<Finding> Run();

 private:
  using Check = std::optional<Finding> (Trial::*)();

  void LookAtStart();
  double Rounding(double cost) const;
  bool SaysAsStock(double cost, double rounding);

  std::optional<Finding> Calls();
  std::optional<Finding> Memory();
  std::optional<Finding> Bounds();
  std::optional<Finding> Costs();
  std::optional<Finding> Termination();
  std::optional<Finding> CheckLimit();
  std::optional<Finding> Trace();
  std::optional<Finding> Repetition();
  std::optional<Finding> End();
  std::optional<Finding> CheckExcess(const Verdict& ours);
  const StockTraces& Stock();
  Verdict StockVerdict();

  const ceres::Solver::Options& options_;
  World* world_;
  SolverUnderTest* solver_;
  Dice* dice_;
  Counts* counts_;
  std::vector<double> start_;
  bool start_has_cost_ = false;   // which is finite
  bool start_evaluates_ = false;  // cost and Jacobians

  double start_cost_ = 0.0;
  ceres::Solver::Summary summary_;
  std::unique_ptr<StockTraces> stock_;
};

void Trial::LookAtStart() {
  std::vector<double> gradient;
  ceres::CRSMatrix jacobian;
  const auto finite = [](double value) { return std::isfinite(value); };
  start_has_cost_ = world_->problem().Evaluate({}, &start_cost_, nullptr, nullptr, nullptr) && finite(start_cost_);
  start_evaluates_ = start_has_cost_ && world_->problem().Evaluate({}, nullptr, nullptr, &gradient, &jacobian) &&

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
  constexpr Check kWithCalls[] = {&Trial::Costs, &Trial::Termination, &Trial::Trace, &Trial::Repetition, &Trial::End};
  std::optional<Finding> finding;
  for (const Check check : kWithoutCalls) {
    finding = finding ? finding : (this->*check)();
  }
  watch.may_call = true;
  for (const Check check : kWithCalls) {
    finding = finding || solver_->used_stock() ? finding : (this->*check)();
  }
  return finding;
}

std::optional<Finding> Trial::Calls() {
  const CallWatch& watch = TheCallWatch();
  if (watch.calls_too_late > 0 || watch.active > 0) {
    return Finding{"called_after_return", Text("%ld calls of cost functions after Solve returned", watch.calls_too_late.load())};
  }
  if (watch.overlapping_calls > 0) {
    return Finding{"called_concurrently", Text("%ld calls at a time with num_threads 1", watch.overlapping_calls.load())};
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
        return Finding{"not_a_number", Text("block %zu has %g", b, values[i])};
      }
      if (values[i] != start_[i] && (failed || block.constant)) {
        return Finding{failed ? "failure_moved_values" : "constant_moved",
                       Text("block %zu: %.17g became %.17g", b, start_[i], values[i])};
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
        return Finding{"beyond_bound", Text("a value of %.17g", block->x[j])};
      }
    }
  }
  return std::nullopt;
}

// Stock's final cost is the least of all iterations, that of a refused step included that gained, but too little for its length:
// memory then has the least accepted one. And where the start cannot be evaluated, what stock says.
bool Trial::SaysAsStock(double cost, double rounding) {
  double accepted = std::numeric_limits<double>::infinity();
  for (const ceres::IterationSummary& iteration : summary_.iterations) {
    accepted = iteration.step_is_successful || iteration.iteration == 0 ? std::min(accepted, iteration.cost) : accepted;
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
    if (solver_->follows_stock() && SaysAsStock(cost, rounding)) {
      return std::nullopt;
    }
    return Finding{"wrong_final_cost", Text("the summary says %s with %.17g, memory has %.17g%s",
                                            ceres::TerminationTypeToString(summary_.termination_type), summary_.final_cost, cost,
                                            evaluated ? "" : " (cannot be evaluated)")};
  }
  if (!options_.use_nonmonotonic_steps && start_has_cost_ && cost > start_cost_ * (1.0 + kSameCost) + rounding) {
    return Finding{"went_up", Text("from %.17g to %.17g", start_cost_, cost)};
  }
  return std::nullopt;
}

std::optional<Finding> Trial::Termination() {
  if (summary_.termination_type == ceres::FAILURE) {
    if (start_evaluates_ && !world_->HasFault() && Stock().summary().termination_type != ceres::FAILURE) {
      return Finding{"failed", "FAILURE from a start that can be evaluated, where stock solves: " + summary_.message};
    }
    ++counts_->failures;
    return std::nullopt;
  }
  // What remembers need not ask for Jacobians.
  const bool start_will_do = solver_->follows_stock() ? start_evaluates_ : start_has_cost_;
  if (!start_will_do && Stock().summary().termination_type == ceres::FAILURE) {
    return Finding{"no_failure",
                   Text("%s from a start that cannot be evaluated: ", ceres::TerminationTypeToString(summary_.termination_type)) +
                       summary_.message};
  }
  if (summary_.termination_type != ceres::NO_CONVERGENCE) {
    return std::nullopt;
  }
  ++counts_->not_converged;
  if (options_.max_num_iterations < kManyIterations || solver_->follows_stock()) {
    return std::nullopt;
  }
  return CheckLimit();
}

// Ours has used up its iterations: is it for nothing, or behind stock?
std::optional<Finding> Trial::CheckLimit() {
  const ceres::Solver::Summary& stock = Stock().summary();
  if (stock.termination_type != ceres::CONVERGENCE ||
      static_cast<double>(stock.iterations.size()) >= kFewShare * options_.max_num_iterations) {
    return std::nullopt;
  }
  const Verdict verdict = Judge(world_, options_.function_tolerance);
  const bool is_there = verdict.judged && !verdict.is_excess;
  if (!is_there && summary_.final_cost < stock.final_cost) {
    return std::nullopt;  // creeps on where stock gave up
  }
  return Finding{is_there ? "does_not_end" : "slow",
                 Text("no convergence in %d iterations, cost %.12g, plain LM goes to %.12g; stock %.12g in %zu",
                      options_.max_num_iterations, summary_.final_cost, verdict.best, stock.final_cost, stock.iterations.size())};
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
  return Finding{"not_repeated",
                 Text("with %d threads %s, cost %.17g, with %d threads %s, cost %.17g; values differ by %.3g%s",
                      options_.num_threads, ceres::TerminationTypeToString(summary_.termination_type), summary_.final_cost,
                      other.num_threads, ceres::TerminationTypeToString(again.termination_type), again.final_cost, difference,
                      forgets ? ", the structure forgotten in between" : "")};
}

// Where plain LM goes from stock's end.
Verdict Trial::StockVerdict() {
  const std::vector<double> values = world_->Values();
  world_->SetValues(Stock().end());
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
    return CheckExcess(verdict);
  }
  return std::nullopt;
}

std::optional<Finding> Trial::CheckExcess(const Verdict& ours) {
  if (ours.is_creeping) {
    ++counts_->creeping;
    counts_->worst_creeping_excess = std::max(counts_->worst_creeping_excess, ours.excess / options_.function_tolerance);
    return std::nullopt;
  }
  const Verdict stock = StockVerdict();
  if (world_->HasFault() && (!stock.judged || stock.is_excess)) {
    ++counts_->beside_faults;
    return std::nullopt;
  }
  const bool is_no_worse = !stock.judged || ours.cost - ours.best <= 2.0 * (stock.cost - stock.best);
  const bool chaotic = solver_->follows_stock() && !Stock().agree() && ours.excess < kChaoticExcess * options_.function_tolerance;
  if ((solver_->may_follow_stock() || Stock().EndedByLength()) && (chaotic || is_no_worse)) {
    ++counts_->as_stock;
    return std::nullopt;
  }
  const std::string kind = world_->HasFault() ? "excess_beside_fault" : is_no_worse ? "excess_as_stock" : "excess";
  return Finding{kind, Text("%.3g tolerances above where plain LM goes, which gains ten in %d steps: %.12g, %.12g (tolerance "
                            "%.2g, %zu iterations); stock "
                            "ends at %.12g with an excess of %.2g tolerances after %zu iterations; ",
                            ours.excess / options_.function_tolerance, ours.steps, ours.cost, ours.best,
                            options_.function_tolerance, summary_.iterations.size(), stock.cost,
                            stock.excess / options_.function_tolerance, Stock().summary().iterations.size()) +
                           summary_.message};
}

}  // namespace

void Counts::Add(const Counts& other) {
  edits += other.edits;
  solves += other.solves;
  handed_to_stock += other.handed_to_stock;
  failures += other.failures;
  not_converged += other.not_converged;
  judged += other.judged;
  creeping += other.creeping;
  beside_faults += other.beside_faults;
  as_stock += other.as_stock;
  traces_compared += other.traces_compared;
  traces_chaotic += other.traces_chaotic;
  worst_creeping_excess = std::max(worst_creeping_excess, other.worst_creeping_excess);
}

std::optional<Finding> SolveAndCheck(const ceres::Solver::Options& options, World* world, SolverUnderTest* solver, Dice* dice,
                                     Counts* counts) {
  return Trial(options, world, solver, dice, counts).Run();
}

}  // namespace inceres::fuzz
