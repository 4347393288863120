#include "trust_region/loop_evaluation.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace inceres::internal {

// Evaluations as the loop sees them. Whatever decides anything goes through the agreement: of one
// process its own value, of several the same bits in all. Counts are passes over the problem, as
// Ceres's evaluator counts them; observers hear of a pass before any cost function is called,
// which is when Ceres has copied the point to user memory (docs/ceres_contract.md, "Callbacks and
// state updates").

namespace {

constexpr char kNotFinite[] = "the sum of all costs is not finite";

}  // namespace

LoopEvaluation::LoopEvaluation(const SolverOptions& options, const LoopOptions& loop,
                               Evaluator* evaluator, StageClock* clock, Summary* summary)
    : options_(options),
      loop_(loop),
      evaluator_(*evaluator),
      clock_(*clock),
      summary_(*summary),
      agreement_(loop.agreement != nullptr ? *loop.agreement : alone_) {
}

// Where one process cannot move, none does.
bool LoopEvaluation::MoveCandidate(const std::vector<double>& step) {
  // Those of a candidate before.
  KeepEvaluations(false, &evaluator_.families());
  return agreement_.All(evaluator_.points().MoveCandidate(step.data()));
}

// Only the first failure of the solve keeps its reason.
bool LoopEvaluation::CandidateCost(double* cost) {
  if (options_.observer != nullptr) {
    options_.observer->BeforeEvaluation(evaluator_.points().candidate().data(), /*jacobians=*/false,
                                        /*new_point=*/true);
  }
  // Counted before the pass, so that one that fails counts.
  ++summary_.work.num_residual_evaluations;
  const Status evaluated = agreement_.Evaluate(
      [this](double* own) { return evaluator_.EvaluateCandidateCost(own); }, cost);
  clock_.Charge(&summary_.seconds.residuals);
  const bool usable = evaluated.ok() && IsUsable(*cost);
  if (!usable && summary_.failed_step.empty()) {
    summary_.failed_step = evaluated.ok() ? kNotFinite : evaluated.message;
  }
  return usable;
}

// A failure here ends the solve, where one at a candidate only refuses a step.
bool LoopEvaluation::Jacobians(bool new_point, double* cost) {
  if (options_.observer != nullptr) {
    // A new point is one at which no cost was asked for: observers are told, as Ceres's callback
    // is.
    options_.observer->BeforeEvaluation(evaluator_.points().current().data(), /*jacobians=*/true,
                                        new_point);
  }
  ++summary_.work.num_jacobian_evaluations;
  const auto evaluation = [this, new_point](double* own) {
    // Tangent maps of an accepted candidate were computed with its cost.
    return evaluator_.EvaluateJacobians(/*known_point=*/!new_point, own);
  };
  const Status evaluated = agreement_.Evaluate(evaluation, cost);
  clock_.Charge(&summary_.seconds.jacobians);
  const bool usable = evaluated.ok() && IsUsable(*cost);
  if (!usable) {
    summary_.detail = evaluated.ok() ? kNotFinite : evaluated.message;
  }
  return usable;
}

// 2.1 does not look at the sum.
bool LoopEvaluation::IsUsable(double cost) const {
  return loop_.rules == CeresRules::k21 || std::isfinite(cost);
}

// visit(begin, end) of the state's entries that move, in the order of the variables: neighbors in
// memory at once.
template <typename Visit>
void LoopEvaluation::ForEachRun(const Visit& visit) const {
  const FactorGraph& graph = evaluator_.graph();
  const std::vector<VariableId>& variables = evaluator_.layout().variables;
  std::int64_t begin = 0, end = 0;
  for (std::size_t i = 0; i < variables.size(); ++i) {
    // A variable that several processes have is counted by one of them.
    if (agreement_.CountsElsewhere(i)) {
      continue;
    }
    const std::int64_t offset = graph.StateOffset(variables[i]);
    if (offset != end) {
      visit(begin, end);
      begin = offset;
    }
    end = offset + graph.AmbientSize(variables[i]);
  }
  visit(begin, end);
}

// Over values, not tangents: Ceres's ‖x‖.
double LoopEvaluation::StateNorm() const {
  double sum = 0.0;
  const double* const x = evaluator_.points().current().data();
  ForEachRun([&sum, x](std::int64_t begin, std::int64_t end) {
    for (std::int64_t k = begin; k < end; ++k) {
      sum += x[k] * x[k];
    }
  });
  return std::sqrt(agreement_.Sum(sum));
}

// Between values, as ‖x − candidate‖ in Ceres; the largest difference is asked for in the test of
// the gradient.
double LoopEvaluation::CandidateDistance(double* max_norm) const {
  double sum = 0.0;
  double largest = 0.0;
  const double* const from = evaluator_.points().current().data();
  const double* const to = evaluator_.points().candidate().data();
  ForEachRun([&sum, from, to](std::int64_t begin, std::int64_t end) {
    for (std::int64_t k = begin; k < end; ++k) {
      const double difference = from[k] - to[k];
      sum += difference * difference;
    }
  });
  // Every process asks in this order, or one would wait for another.
  if (max_norm != nullptr) {
    ForEachRun([&largest, from, to](std::int64_t begin, std::int64_t end) {
      for (std::int64_t k = begin; k < end; ++k) {
        largest = std::max(largest, std::fabs(from[k] - to[k]));
      }
    });
    *max_norm = agreement_.Max(largest);
  }
  return std::sqrt(agreement_.Sum(sum));
}

}  // namespace inceres::internal
