#include "trust_region/candidate_refinement.h"

#include <vector>

namespace inceres::internal {

// Moves the candidate on before its step is judged. Both ways add what they gain to the step's
// promise, as Ceres does, so that the gain ratio judges the step's model and not the refinement.
// They are independent: refine_landmarks is ours, the rounds come with Ceres's
// use_inner_iterations.

namespace {

// A landmark moves by itself if it gains more than this share of what the function tolerance allows
// all of them together.
constexpr double kInnerShare = 0.01;

}  // namespace

CandidateRefinement::CandidateRefinement(const SolverOptions& options, const LoopOptions& loop,
                                         LoopEvaluation* evaluation, Summary* summary)
    : options_(options), loop_(loop), evaluation_(*evaluation), summary_(*summary) {
  Evaluator& evaluator = evaluation->evaluator();
  if (options.refine_landmarks && evaluator.layout().num_landmarks() > 0) {
    inner_iterations_ = std::make_unique<InnerIterations>(&evaluator);
    summary->work.bytes += inner_iterations_->Bytes();
  }
  if (loop.inner_descent != nullptr) {
    coordinate_descent_ =
        std::make_unique<CoordinateDescent>(*loop.inner_descent, loop.rules, &evaluator);
  }
}

double CandidateRefinement::RefineLandmarks(double cost, double candidate_cost) {
  const double step_gain = cost - candidate_cost;
  // Steps that do not creep need no help (InnerIterations::IsDue).
  if (inner_iterations_ == nullptr || !inner_iterations_->IsDue(step_gain)) {
    return 0.0;
  }
  // The function tolerance of what can change of the cost, a share of it for each landmark.
  const double min_gain = kInnerShare * options_.function_tolerance * (cost - loop_.fixed_cost) /
                          evaluation_.evaluator().layout().num_landmarks();
  const double gain = inner_iterations_->Run(min_gain, step_gain);
  summary_.work.num_refined_landmarks += inner_iterations_->num_moved();
  // What this round has gained decides how long the next one waits.
  inner_iterations_->Pace(gain, step_gain);
  return gain;
}

std::optional<double> CandidateRefinement::Descend(double candidate_cost) {
  InnerDescent& inner = *loop_.inner_descent;
  StageClock& clock = evaluation_.clock();
  const double start = clock.Read();
  ++inner.num_rounds;
  PointPair& points = evaluation_.evaluator().points();
  // A copy of all values: the round moves them in place, and may end where nothing can be
  // evaluated.
  const std::vector<double> before = points.candidate();
  coordinate_descent_->Run();
  double cost = 0.0;
  // Back to the candidate before the round, whose cost is known, with tangent maps that are right
  // again when it is accepted.
  if (!evaluation_.CandidateCost(&cost)) {
    points.mutable_candidate() = before;
    // they were those of the point that failed
    static_cast<void>(points.ComputeCandidateTangents());
    return std::nullopt;
  }
  // Written so that NaN ends it. Once a round was worth too little there are no more in this
  // solve.
  if (!(1.0 - cost / candidate_cost > inner.tolerance)) {
    coordinate_descent_.reset();
  }
  inner.seconds += clock.Read() - start;
  return cost;
}

}  // namespace inceres::internal
