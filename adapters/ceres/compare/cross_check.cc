#include "adapters/ceres/compare/cross_check.h"

#include <memory>
#include <string>
#include <vector>

#include <glog/logging.h>

#include "adapters/ceres/compare/ab_log.h"
#include "adapters/ceres/compare/compare_solves.h"
#include "adapters/ceres/compare/disagreement.h"
#include "adapters/ceres/compare/second_opinion.h"
#include "adapters/ceres/fallback/gate.h"
#include "adapters/ceres/fallback/stock_ceres.h"
#include "adapters/ceres/plan/solve_input.h"
#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/read/user_state.h"

namespace inceres::internal {
namespace {

// Puts the start values back unless told that all went well.
class StartGuard {
 public:
  StartGuard(const UserState& layout, const std::vector<double>& start) : layout_(layout), start_(start) {}
  ~StartGuard() {
    if (armed_) {
      layout_.Write(start_);
    }
  }
  StartGuard(const StartGuard&) = delete;
  StartGuard& operator=(const StartGuard&) = delete;
  void Disarm() { armed_ = false; }

 private:
  const UserState& layout_;
  const std::vector<double>& start_;
  bool armed_ = true;
};

struct Call {
  const ceres::Solver::Options& options;
  ceres::Problem* problem;
  ceres::Solver::Summary* summary;
  SolveReport* report;
  const OurSolve& ours;
};

// Seconds of our solve, without the caller's callbacks.
double SolveWithOurs(const Call& call) {
  const WallClock clock;
  call.ours.once();
  return clock.Seconds() - call.report->callback_seconds;
}

void SolveWithBoth(const Call& call, SolveMode mode, CrossCheckResult* result) {
  const UserState layout(*call.problem);
  SolvedStates states;
  states.start = layout.Read();
  StartGuard guard(layout, states.start);
  const ceres::Solver::Options for_stock = QuietOptions(call.options);
  const auto solve_with_stock = [&] {
    const WallClock clock;
    SolveWithStock(for_stock, call.problem, &result->stock);
    result->stock_seconds = clock.Seconds();
    states.stock = layout.Read();
    layout.Write(states.start);
  };
  if (result->first == SolvedBy::kStock) {
    solve_with_stock();
  }
  result->our_seconds = SolveWithOurs(call);
  result->ours = *call.summary;
  states.ours = layout.Read();
  if (result->first == SolvedBy::kOurs) {
    layout.Write(states.start);
    solve_with_stock();
  }
  const JudgedTolerances tolerances = TolerancesFor(mode, call.report->cross_check, call.options);
  Compare(layout, states, tolerances, Excuse(), result);
  result->compared = true;
  if (WantsSecondOpinion(call.report->cross_check, *result)) {
    SecondOpinion(call.options, call.problem, layout, states, tolerances, call.report->cross_check.spread_factor, call.ours.again)
        .Judge(result);
  }
  const bool ended_by_callback =
      result->ours.termination_type == ceres::USER_SUCCESS || result->ours.termination_type == ceres::USER_FAILURE;
  result->kept = ended_by_callback ? SolvedBy::kOurs : call.report->cross_check.keep;
  guard.Disarm();
  layout.Write(result->kept == SolvedBy::kOurs ? states.ours : states.stock);
  if (result->kept == SolvedBy::kStock) {
    *call.summary = result->stock;
  }
}

void SolveWithOne(const Call& call, CrossCheckResult* result) {
  const double seconds = SolveWithOurs(call);
  if (call.report->used_stock) {
    result->stock = *call.summary;
    result->stock_seconds = seconds;
    result->first = result->kept = SolvedBy::kStock;
  } else {
    result->ours = *call.summary;
    result->our_seconds = seconds;
  }
}

// Why the two cannot be compared; empty if they can.
std::string ComparisonObstacle(const Call& call, SolveMode mode) {
  const Status valid = call.report->cross_check.Validate();
  if (!valid.ok()) {
    LOG(ERROR) << "inceres: no cross-check: " << valid.message;
    return valid.message;
  }
  if (mode == SolveMode::kStock) {
    return "SolveMode::kStock was asked for";
  }
  if (INCERES_CERES_RELEASE < 202 && call.options.use_mixed_precision_solves &&
      call.options.sparse_linear_algebra_library_type == ceres::SUITE_SPARSE) {
    return "stock Ceres aborts the process on use_mixed_precision_solves with SUITE_SPARSE";
  }
  ceres::EvaluationCallback* const callback = EvaluationCallbackOf(*call.problem, call.report->evaluation_callback);
  ProblemView view;
  OrderingView ordering;
  const std::string obstacle =
      FindObstacle(call.options, *call.problem, mode == SolveMode::kIncremental, callback, &view, &ordering);
  if (obstacle.empty() && callback != nullptr) {
    return "the problem has an evaluation callback, which a second solve would call again";
  }
  return obstacle;
}

}  // namespace

void SolveAndCompare(const ceres::Solver::Options& options, ceres::Problem* problem, ceres::Solver::Summary* summary,
                     SolveReport* report, SolveMode mode, const OurSolve& ours, const std::string& obstacle) {
  const Call call{options, problem, summary, report, ours};
  const bool logged = !report->ab_log.empty();
  const auto result = std::make_shared<CrossCheckResult>();
  result->reason = obstacle.empty() ? ComparisonObstacle(call, mode) : obstacle;
  if (result->reason.empty()) {
    result->first = logged && StockGoesFirst(report->ab_log) ? SolvedBy::kStock : SolvedBy::kOurs;
    SolveWithBoth(call, mode, result.get());
  } else {
    SolveWithOne(call, result.get());
  }
  report->comparison = result;
  if (!result->violations.empty()) {
    LOG(WARNING) << DescribeDisagreement(*result);
  } else if (!result->within_spread.empty()) {
    LOG(INFO) << DescribeExcuse(*result);
  }
  const bool refused = !report->used_stock && !report->fallback_reason.empty();
  if (logged && !refused) {
    AppendToLog(report->ab_log, LogLine(*report, mode, options, *summary, NextNumberInLog(report->ab_log)));
  }
}

}  // namespace inceres::internal
