#include "adapters/ceres/compare/second_opinion.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <sstream>
#include <utility>

#include "adapters/ceres/fallback/stock_ceres.h"
#include "adapters/ceres/plan/other_linear_solvers.h"
#include "adapters/ceres/plan/solve_input.h"

namespace inceres::internal {
namespace {

using Options = ceres::Solver::Options;

std::string Excused(double first, double again) {
  std::ostringstream text;
  text.precision(12);
  text << "the cost functions remember earlier calls: at the same start the cost was " << first << ", then " << again
       << "; with what they remember now, ours and stock agree";
  return text.str();
}

}  // namespace

Options QuietOptions(const Options& options) {
  Options quiet = options;
  quiet.callbacks.clear();
  quiet.minimizer_progress_to_stdout = false;
  quiet.logging_type = ceres::SILENT;
  if (options.linear_solver_ordering != nullptr) {
    quiet.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>(*options.linear_solver_ordering);
  }
  return quiet;
}

bool WantsSecondOpinion(const CrossCheckOptions& check, const CrossCheckResult& result) {
  static std::atomic<std::uint64_t> num_comparisons{0};
  const std::uint64_t number = ++num_comparisons;
  if (check.spread_factor <= 0.0) {
    return false;
  }
  return !result.violations.empty() ||
         (check.spread_interval > 0 && number % static_cast<std::uint64_t>(check.spread_interval) == 0);
}

SecondOpinion::SecondOpinion(const Options& options, ceres::Problem* problem, const UserState& layout, const SolvedStates& states,
                             const JudgedTolerances& tolerances, double factor, const SolveAgain& ours_again)
    : quiet_(QuietOptions(options)),
      problem_(problem),
      layout_(layout),
      states_(states),
      tolerances_(tolerances),
      factor_(factor),
      ours_again_(ours_again) {
}

void SecondOpinion::Judge(CrossCheckResult* result) {
  std::vector<std::string> suspected = result->violations;
  for (const Options& other : OtherLinearSolvers(quiet_, result->stock)) {
    SolveWith(other, result);
    JudgeAnew(result);
    if (result->violations.empty()) {
      break;
    }
  }
  if (!result->violations.empty() && CostFunctionsRemember(result)) {
    result->violations.clear();
  }
  if (result->violations.empty()) {
    result->within_spread = std::move(suspected);
  }
}

// A solver that fails where the one asked for does not is no measure of it.
void SecondOpinion::SolveWith(const Options& other, CrossCheckResult* result) {
  CrossCheckResult pair;
  pair.stock = result->stock;
  layout_.Write(states_.start);
  const WallClock clock;
  SolveWithStock(other, problem_, &pair.ours);
  const double seconds = clock.Seconds();
  if (result->stock.IsSolutionUsable() && !pair.ours.IsSolutionUsable()) {
    return;
  }
  const SolvedStates states = {states_.start, layout_.Read(), states_.stock};
  Compare(layout_, states, tolerances_, Excuse(), &pair);
  Widen(pair, factor_, &excuse_);
  if (!result->spread) {
    result->spread.emplace().linear_solvers = ceres::LinearSolverTypeToString(result->stock.linear_solver_type_used);
  }
  StockSpread& spread = *result->spread;
  spread.linear_solvers += std::string(", ") + ceres::LinearSolverTypeToString(pair.ours.linear_solver_type_used);
  spread.cost = std::max(spread.cost, std::abs(pair.cost_difference));
  spread.parameter = std::max(spread.parameter, pair.parameters.relative);
  const int surplus = static_cast<int>(pair.ours.iterations.size()) - static_cast<int>(pair.stock.iterations.size());
  spread.iterations = std::max(spread.iterations, std::abs(surplus));
  if (pair.first_different_iteration >= 0) {
    spread.first_different_iteration = spread.first_different_iteration < 0
                                           ? pair.first_different_iteration
                                           : std::min(spread.first_different_iteration, pair.first_different_iteration);
  }
  spread.seconds += seconds;
}

void SecondOpinion::JudgeAnew(CrossCheckResult* result) const {
  result->violations.clear();
  result->first_different_iteration = -1;
  result->parameters = ParameterDifference();
  Compare(layout_, states_, tolerances_, excuse_, result);
}

// Our solver makes the same bits of the same problem. What makes it meet another cost at the same start is not in it. Failures
// are never excused by this.
bool SecondOpinion::CostFunctionsRemember(CrossCheckResult* result) const {
  if (ours_again_ == nullptr || !result->stock.IsSolutionUsable() || !result->ours.IsSolutionUsable()) {
    return false;
  }
  CrossCheckResult again;
  again.stock = result->stock;
  layout_.Write(states_.start);
  ours_again_(quiet_, &again.ours);
  if (again.ours.initial_cost == result->ours.initial_cost) {
    return false;
  }
  Compare(layout_, {states_.start, layout_.Read(), states_.stock}, tolerances_, excuse_, &again);
  if (!again.violations.empty()) {
    return false;
  }
  result->first_different_iteration = -1;
  result->reason = Excused(result->ours.initial_cost, again.ours.initial_cost);
  return true;
}

}  // namespace inceres::internal
