#include "trust_region/loop_evaluation.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <Eigen/Core>

namespace inceres::internal {

// Evaluations as the loop sees them. Whatever decides anything goes through the agreement: of one
// process its own value, of several the same bits in all; and so does all code of the user, which
// may throw in one process alone. Counts are passes over the problem, as Ceres's evaluator counts
// them; observers hear of a pass before any cost function is called, which is when Ceres has copied
// the point to user memory (docs/ceres_contract.md, "Callbacks and state updates").

namespace {

constexpr char kNotFinite[] = "the sum of all costs is not finite";

auto Entries(const std::vector<double>& state, std::int64_t begin, std::int64_t end) {
  return Eigen::Map<const Eigen::VectorXd>(state.data() + begin, end - begin);
}

}  // namespace

LoopEvaluation::LoopEvaluation(const LoopParts& parts)
    : parts_(parts),
      agreement_(parts.loop.agreement != nullptr ? *parts.loop.agreement : alone_),
      has_observers_(!agreement_.All(parts.options.observer == nullptr)) {
  FindRuns();
}

// Where one process cannot move, none does. Manifolds may be the user's: so they are asked, as an
// observer is.
bool LoopEvaluation::MoveCandidate(const std::vector<double>& step) {
  // Those of a candidate before.
  KeepEvaluations(false, &parts_.evaluator.families());
  const auto move = [this, &step] {
    return parts_.evaluator.points().MoveCandidate(step.data()) ? ObserverAction::kContinue
                                                                : ObserverAction::kAbort;
  };
  return agreement_.Ask(move) == ObserverAction::kContinue;
}

// The tangent maps at a new point, if anybody is to be told of it, else they come with the
// evaluation. Ceres calls PlusJacobian first, and tells nobody of a point where it fails.
Status LoopEvaluation::ComputeTangents(bool candidate) const {
  if (!has_observers_) {
    return Status::Ok();
  }
  double none = 0.0;
  const auto compute = [this, candidate](double* own) {
    *own = 0.0;
    PointPair& points = parts_.evaluator.points();
    return candidate ? points.ComputeCandidateTangents() : points.ComputeTangents();
  };
  return agreement_.Evaluate(compute, &none);
}

// Not in the evaluation that follows: where that throws, factors are evaluated once more to find
// the one that did.
void LoopEvaluation::TellObservers(bool jacobians, bool new_point) const {
  // No process asks if none has an observer.
  if (!has_observers_) {
    return;
  }
  agreement_.Ask([this, jacobians, new_point] {
    if (parts_.options.observer != nullptr) {
      const PointPair& points = parts_.evaluator.points();
      parts_.options.observer->BeforeEvaluation(
          (jacobians ? points.current() : points.candidate()).data(), jacobians, new_point);
    }
    return ObserverAction::kContinue;
  });
}

// Summed over all processes, so that all of them begin anew or none does.
int LoopEvaluation::Recenter() {
  int own = 0;
  agreement_.Ask([this, &own] {
    own = parts_.evaluator.Recenter();
    return ObserverAction::kContinue;
  });
  return static_cast<int>(agreement_.Sum(own));
}

// Only the first failure of the solve keeps its reason.
bool LoopEvaluation::CandidateCost(double* cost) {
  // Counted before the pass, so that one that fails counts.
  ++parts_.summary.work.num_residual_evaluations;
  const auto evaluation = [this](double* own) {
    return parts_.evaluator.EvaluateCandidateCost(own, /*knows_tangents=*/has_observers_);
  };
  Status evaluated = ComputeTangents(/*candidate=*/true);
  if (evaluated.ok()) {
    TellObservers(/*jacobians=*/false, /*new_point=*/true);
    evaluated = agreement_.Evaluate(evaluation, cost);
  }
  parts_.clock.Charge(&parts_.summary.seconds.residuals);
  const bool usable = evaluated.ok() && IsUsable(*cost);
  if (!usable && parts_.summary.failed_step.empty()) {
    parts_.summary.failed_step = evaluated.ok() ? kNotFinite : evaluated.message;
  }
  return usable;
}

bool LoopEvaluation::TakesCurvatureBack() {
  const bool was_reduced = parts_.evaluator.loss_curvature() == LossCurvature::kBoth;
  if (was_reduced) {
    parts_.evaluator.set_loss_curvature(LossCurvature::kPositive);
  }
  return was_reduced;
}

// A failure here ends the solve, where one at a candidate only refuses a step.
bool LoopEvaluation::Jacobians(bool new_point, double* cost) {
  ++parts_.summary.work.num_jacobian_evaluations;
  const auto evaluation = [this, new_point](double* own) {
    return parts_.evaluator.EvaluateJacobians(/*known_point=*/!new_point, own,
                                              /*knows_tangents=*/has_observers_);
  };
  // Tangent maps of an accepted candidate were computed with its cost.
  Status evaluated = new_point ? ComputeTangents(/*candidate=*/false) : Status::Ok();
  if (evaluated.ok()) {
    // A new point is one at which no cost was asked for: observers are told, as Ceres's callback
    // is.
    TellObservers(/*jacobians=*/true, new_point);
    evaluated = agreement_.Evaluate(evaluation, cost);
  }
  parts_.clock.Charge(&parts_.summary.seconds.jacobians);
  const bool usable = evaluated.ok() && IsUsable(*cost);
  if (!usable) {
    parts_.summary.detail = evaluated.ok() ? kNotFinite : evaluated.message;
  }
  return usable;
}

// 2.1 does not look at the sum.
bool LoopEvaluation::IsUsable(double cost) const {
  return parts_.loop.rules == CeresRules::k21 || std::isfinite(cost);
}

// Neighbors in memory are one run.
void LoopEvaluation::FindRuns() {
  parts_.memory.runs.clear();
  const FactorGraph& graph = parts_.evaluator.graph();
  const std::vector<VariableId>& variables = parts_.evaluator.layout().variables;
  for (std::size_t i = 0; i < variables.size(); ++i) {
    // A variable that several processes have is counted by one of them.
    if (agreement_.CountsElsewhere(i)) {
      continue;
    }
    const std::int64_t offset = graph.StateOffset(variables[i]);
    if (parts_.memory.runs.empty() || parts_.memory.runs.back().end != offset) {
      parts_.memory.runs.push_back({offset, offset});
    }
    parts_.memory.runs.back().end += graph.AmbientSize(variables[i]);
  }
}

// Over values, not tangents: Ceres's ‖x‖.
double LoopEvaluation::StateNorm() const {
  double sum = 0.0;
  for (const StateRun& run : parts_.memory.runs) {
    sum += Entries(parts_.evaluator.points().current(), run.begin, run.end).squaredNorm();
  }
  return std::sqrt(agreement_.Sum(sum));
}

// Between values, as ‖x − candidate‖ in Ceres; the largest difference is asked for in the test of
// the gradient.
double LoopEvaluation::CandidateDistance(double* max_norm) const {
  double sum = 0.0;
  double largest = 0.0;
  for (const StateRun& run : parts_.memory.runs) {
    const auto difference = Entries(parts_.evaluator.points().current(), run.begin, run.end) -
                            Entries(parts_.evaluator.points().candidate(), run.begin, run.end);
    sum += difference.squaredNorm();
    if (max_norm != nullptr) {
      // Ceres's is Eigen's, which passes over what is no number unless it comes first.
      const double of_run = difference.lpNorm<Eigen::Infinity>();
      largest = &run == &parts_.memory.runs.front() ? of_run : std::max(largest, of_run);
    }
  }
  // Every process asks in this order, or one would wait for another.
  if (max_norm != nullptr) {
    *max_norm = agreement_.Max(largest);
  }
  return std::sqrt(agreement_.Sum(sum));
}

}  // namespace inceres::internal
