// Steps of single landmarks with the frames held: TrialStep::TryLandmarks (the embedded point
// iteration of ICE-BA).

#include <algorithm>

#include "incremental/trial_step.h"

namespace inceres::internal {

// Given the frames, landmarks are independent of each other (docs/algorithms.md, "Landmark
// refinement"), so each steps and is judged by the change of its own factors' costs. All of them
// are evaluated in one pass, family by family, and those that lose are left out of what is then
// accepted as a step like any other.
//
// The step is t U_invᵀ z. What a landmark's last step has shown of its cost is kept as the stretch
// t of its next one, until its values are set or another landmark takes its number.

// The step that Visit has found, t times; longer, it may leave bounds that it was within.
void TrialStep::Stretch(std::int32_t landmark) {
  const IncrementalSchur::Landmark& l = schur_.landmarks()[landmark];
  double* step = step_.data() + std::ptrdiff_t{l.quad} * kQuad;
  for (int k = 0; k < l.size; ++k) {
    step[k] *= landmark_steps_[landmark].stretch;
  }
  CutOff(l.id, l.quad);
}

bool TrialStep::EvaluateLandmarks(const std::vector<std::int32_t>& landmarks, int* num_evaluated) {
  for (const std::int32_t landmark : landmarks) {
    const IncrementalSchur::Landmark& l = schur_.landmarks()[landmark];
    Visit(landmark);
    Stretch(landmark);
    Move(l.id, l.quad);
    Touch(l.factors);
    LandmarkStep& step = landmark_steps_[landmark];
    // Summed below over the landmark's factors.
    step.change = step.slope = 0.0;
  }
  for (IncrementalFamily& family : families_) {
    std::vector<std::int32_t>& touched = touched_lists_[family.id()];
    // Ascending, as evaluation and sums want them. No frame moves, so these are all factors of the
    // landmarks and no others.
    touched_[family.id()].CopyTo(&touched);
    *num_evaluated += static_cast<int>(touched.size());
    // One refusal takes back the whole pass.
    if (family.EvaluateCandidate(touched, executor_).failed()) {
      return false;
    }
    family.PredictDecrease(touched, step_.data());
    for (const std::int32_t i : touched) {
      LandmarkStep& step = landmark_steps_[schur_.structure().LandmarkOfFactor({family.id(), i})];
      double slope = 0.0;
      double curvature = 0.0;
      family.Slope(i, &slope, &curvature);
      step.change += family.CandidateCost(i) - family.Cost(i);
      // −qᵀJδ: the decrease that the gradient promises along this step.
      step.slope += slope;
    }
  }
  return true;
}

// Whether the landmark's step lowers its cost; and how long the next one is to be, as a multiple of
// what its model says.
bool TrialStep::KeepLandmark(std::int32_t landmark) {
  LandmarkStep& step = landmark_steps_[landmark];
  // Also with a NaN. The search begins anew with the step that the model says.
  if (!(step.change < 0.0) || !(step.slope > 0.0)) {
    step.stretch = 1.0;
    return false;
  }
  // With a robust loss the Gauss–Newton model of an outlier is too stiff, and damping holds a far
  // point back: the next step is taken as long as the slope and the curvature seen along this one
  // ask for, within a bound. The cost along the step is − slope t + ½ curvature t² and `change` at
  // t = 1.
  const double curvature = 2.0 * (step.slope + step.change);
  // The minimum of the parabola, as a multiple of this step. A curvature that is small, or
  // negative, where the cost falls faster than its slope, gives the bound.
  const double best = step.slope / std::max(curvature, step.slope / max_stretch_);
  // Never below 1: a step that has gained is not shortened the next time.
  step.stretch = std::clamp(step.stretch * best, 1.0, max_stretch_);
  return true;
}

// As if it had never been visited.
void TrialStep::LeaveOut(std::int32_t landmark) {
  const IncrementalSchur::Landmark& l = schur_.landmarks()[landmark];
  variables_.Reject(l.id);
  visited_.Remove(landmark);
  std::fill_n(step_.begin() + std::ptrdiff_t{l.quad} * kQuad, l.size, 0.0);
  for (const FactorRef& ref : l.factors) {
    // A factor has at most one landmark that moves, so nobody else needs it.
    touched_[ref.family].Remove(ref.factor);
  }
}

bool TrialStep::TryLandmarks(const std::vector<std::int32_t>& landmarks, int* num_evaluated) {
  *num_evaluated = 0;
  if (!EvaluateLandmarks(landmarks, num_evaluated)) {
    Reject();
    return false;
  }
  for (const std::int32_t landmark : landmarks) {
    if (!KeepLandmark(landmark)) {
      LeaveOut(landmark);
    }
  }
  // No step: nothing was written to the right-hand sides yet.
  if (visited_.empty()) {
    End();
    return false;
  }
  // The lists again, of those that are left, and the frames whose b follows.
  NameTouched();
  for (IncrementalFamily& family : families_) {
    // What accepting does to the right-hand sides; costs were compared above.
    family.TryStep(touched_lists_[family.id()], step_.data(), schur_.padded_change());
  }
  return true;
}

}  // namespace inceres::internal
