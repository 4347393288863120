#include "adapters/ceres/compare/cross_check.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glog/logging.h>

#include "adapters/ceres/compare/ab_log.h"
#include "adapters/ceres/compare/compare_solves.h"
#include "adapters/ceres/compare/second_opinion.h"
#include "adapters/ceres/fallback/gate.h"
#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/read/user_state.h"
#include "src/base/option_rules.h"
#include "src/base/stopwatch.h"

namespace inceres {

// A tolerance that is not set breaks no rule.
Status CrossCheckOptions::Validate() const {
  return internal::OptionRules("CrossCheckOptions")
      .NotNegative("cost_tolerance", cost_tolerance.value_or(0.0))
      .NotNegative("parameter_tolerance", parameter_tolerance.value_or(0.0))
      .NotNegative("iteration_tolerance", iteration_tolerance.value_or(0))
      .NotNegative("radius_tolerance", radius_tolerance.value_or(0.0))
      .NotNegative("spread_factor", spread_factor)
      .NotNegative("spread_interval", spread_interval)
      .status();
}

namespace internal {
namespace {

using OurSolve = std::function<void(const SolveCall&)>;

// Seconds of our solve, without the caller's callbacks.
double SolveWithOurs(const SolveCall& call, const OurSolve& ours) {
  const double seconds = SecondsOf([&] { ours(call); });
  return seconds - call.report->callback_seconds;
}

// Null if it must not be done again.
SecondOpinion::SolveAgain Again(const SolveCall& call, const OurSolve& ours,
                                Repeatable repeatable) {
  if (repeatable == Repeatable::kNo) {
    return nullptr;
  }
  return [&call, &ours](const ceres::Solver::Options& quiet, ceres::Solver::Summary* summary) {
    SolveOptions strict;
    strict.mode = call.solve_options.mode;
    strict.strict = true;
    SolveReport unread;
    ours({quiet, call.problem, summary, strict, &unread});
  };
}

// Who solved it alone: stock, where ours has handed it over. A strict refusal counts as ours.
void NoteOnlyOne(const SolveCall& call, double seconds, CrossCheckResult* result) {
  if (call.report->used_stock) {
    result->stock = *call.summary;
    result->stock_seconds = seconds;
    result->first = result->kept = SolvedBy::kStock;
  } else {
    result->ours = *call.summary;
    result->our_seconds = seconds;
  }
}

// Puts what is to be kept into the summary and the user's memory.
void LeaveKept(const SolveCall& call, const UserState& layout, const SolvedStates& states,
               CrossCheckResult* result) {
  const bool ended_by_callback = result->ours.termination_type == ceres::USER_SUCCESS ||
                                 result->ours.termination_type == ceres::USER_FAILURE;
  result->kept = ended_by_callback ? SolvedBy::kOurs : call.solve_options.cross_check.keep;
  layout.Write(result->kept == SolvedBy::kOurs ? states.ours : states.stock);
  if (result->kept == SolvedBy::kStock) {
    *call.summary = result->stock;
  }
}

void SolveWithBoth(const SolveCall& call, const OurSolve& ours, Repeatable repeatable,
                   CrossCheckResult* result) {
  const CrossCheckOptions& check = call.solve_options.cross_check;
  const UserState layout(*call.problem);
  SolvedStates states;
  states.start = layout.Read();
  StartValues guard(layout);
  const ceres::Solver::Options for_stock = QuietOptions(call.options);
  const auto solve_with_stock = [&] {
    result->stock_seconds =
        SecondsOf([&] { SolveWithStock(for_stock, call.problem, &result->stock); });
    states.stock = layout.Read();
    layout.Write(states.start);
  };
  if (result->first == SolvedBy::kStock) {
    solve_with_stock();
  }
  const double our_seconds = SolveWithOurs(call, ours);
  if (!call.report->fallback_reason.empty()) {
    // Found out when it planned. Stock has the caller's callbacks and output then; what it did
    // before, without them, goes for nothing.
    guard.Keep();
    *result = CrossCheckResult();
    result->reason = call.report->fallback_reason;
    NoteOnlyOne(call, our_seconds, result);
    return;
  }
  result->our_seconds = our_seconds;
  result->ours = *call.summary;
  states.ours = layout.Read();
  if (result->first == SolvedBy::kOurs) {
    layout.Write(states.start);
    solve_with_stock();
  }
  const JudgedTolerances tolerances = TolerancesFor(call.solve_options, call.options);
  Compare(layout, states, tolerances, Excuse(), result);
  result->compared = true;
  if (WantsSecondOpinion(check, *result)) {
    const SecondOpinion::SolveAgain again = Again(call, ours, repeatable);
    SecondOpinion(call.options, call.problem, layout, states, tolerances, check.spread_factor,
                  again)
        .Judge(result);
  }
  guard.Keep();
  LeaveKept(call, layout, states, result);
}

// Why the two cannot be compared; empty if they can.
std::string ComparisonObstacle(const SolveCall& call) {
  const SolveOptions& asked = call.solve_options;
  const Status valid = asked.Validate();
  if (!valid.ok()) {
    LOG(ERROR) << "inceres: no cross-check: " << valid.message;
    return valid.message;
  }
  if (asked.mode == SolveMode::kStock) {
    return "SolveMode::kStock was asked for";
  }
  if (INCERES_CERES_RELEASE < 202 && call.options.use_mixed_precision_solves &&
      call.options.sparse_linear_algebra_library_type == ceres::SUITE_SPARSE) {
    return "stock Ceres aborts the process on use_mixed_precision_solves with SUITE_SPARSE";
  }
  ceres::EvaluationCallback* const callback =
      EvaluationCallbackOf(*call.problem, asked.evaluation_callback);
  const std::string obstacle =
      FindObstacle(call.options, asked.mode == SolveMode::kIncremental, callback, *call.problem);
  if (obstacle.empty() && callback != nullptr) {
    return "the problem has an evaluation callback, which a second solve would call again";
  }
  return obstacle;
}

void SolveAndCompare(const SolveCall& call, const OurSolve& ours, Repeatable repeatable,
                     const std::string& obstacle) {
  const std::string& log = call.solve_options.ab_log;
  SolveReport* report = call.report;
  const auto result = std::make_shared<CrossCheckResult>();
  result->reason = obstacle.empty() ? ComparisonObstacle(call) : obstacle;
  if (result->reason.empty()) {
    result->first = !log.empty() && StockGoesFirst(log) ? SolvedBy::kStock : SolvedBy::kOurs;
    SolveWithBoth(call, ours, repeatable, result.get());
  } else {
    NoteOnlyOne(call, SolveWithOurs(call, ours), result.get());
  }
  report->comparison = result;
  if (!result->violations.empty()) {
    LOG(WARNING) << DescribeDisagreement(*result);
  } else if (!result->within_spread.empty()) {
    LOG(INFO) << DescribeExcuse(*result);
  }
  const bool refused = !report->used_stock && !report->fallback_reason.empty();
  if (!log.empty() && !refused) {
    AppendToLog(log, LogLine(call, NextNumberInLog(log)));
  }
}

}  // namespace

void SolveAsAsked(SolveCall call, const OurSolve& ours, Repeatable repeatable,
                  const std::string& obstacle) {
  CHECK(call.problem != nullptr);  // as ceres::Solve
  CHECK(call.summary != nullptr);
  std::optional<SolveReport> unread;
  if (call.report == nullptr) {
    call.report = &unread.emplace();
  } else {
    *call.report = SolveReport();
  }
  *call.summary = ceres::Solver::Summary();
  if (call.solve_options.cross_check.enabled || !call.solve_options.ab_log.empty()) {
    SolveAndCompare(call, ours, repeatable, obstacle);
  } else {
    ours(call);
  }
}

}  // namespace internal
}  // namespace inceres
