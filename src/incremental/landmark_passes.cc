#include "incremental/landmark_passes.h"

#include <algorithm>

#include "base/stopwatch.h"

namespace inceres::internal {

// Steps of landmarks alone (docs/algorithms.md, "Landmark refinement" and "Stopping rule"). Given
// the frames, landmarks are independent of each other: each steps, and is accepted, for itself, so
// a pass needs neither S nor its factor and costs the factors of those that step.
//
// There are two reasons for a pass. After a step of the frames, where landmarks hold more than half
// of what is left, up to `max_landmark_refinements` of them follow, which saves solves of the whole
// system; and where a claim of convergence depends on what landmarks have left (L of the stopping
// rule), those that decide it are asked by stepping. The two have counts of their own, and both
// begin anew with a step of the frames: without the second limit a claim could wait forever for
// landmarks that creep.

// The sum is kept by difference, and summed anew where rounding may have eaten a share of what the
// Update may leave. G of the stopping rule, Σ ½ ‖z‖² over the landmarks.
double LandmarkPasses::Gain() const {
  return context_.system.schur().gains().Total(context_.tuning.truncate.sum_share *
                                               context_.stop.Allowed(context_.system.cost()));
}

// Less than a share of σT is not worth the evaluations: it would be left by the claim in any case.
bool LandmarkPasses::Step() {
  const double gain = Gain();
  if (num_left_ <= 0 ||
      gain <= context_.tuning.landmarks.share * context_.stop.Allowed(context_.system.cost())) {
    return false;
  }
  --num_left_;
  return Pass(ShareOfMean(gain), gain);
}

// Those step whose own gain exceeds a share of the mean: a few outliers mostly hold nearly all of
// it.
double LandmarkPasses::ShareOfMean(double gain) const {
  const int count = std::max(1, context_.system.schur().structure().num_landmarks());
  return context_.tuning.landmarks.share * gain / count;
}

// Landmarks whose gain is above the threshold take a step. The stopping rule is told what the pass
// gained, what those that stepped have left, by their line searches, and what all the others
// promise: its L is made of these. It is told also where none has moved, for that is an answer.
bool LandmarkPasses::Pass(double threshold, double gain) {
  IncrementalSystem& system = context_.system;
  UpdateSummary& summary = *context_.summary;
  const StageTimer timer(&summary.landmark_seconds);
  const double cost = system.cost();
  int num_evaluated = 0;
  const bool moved = system.StepLandmarks(system.schur().gains().Above(threshold), &num_evaluated);
  context_.stop.LandmarksStepped(cost - system.cost(), system.step().landmark_searches().left(),
                                 gain - system.step().landmark_searches().promised());
  ++summary.num_landmark_refinements;
  summary.num_evaluated_factors += num_evaluated;
  if (moved) {
    UpdateIteration& row = context_.row();
    row.step = UpdateStep::kLandmarks;
    row.step_is_successful = true;
    row.cost_change = cost - system.cost();
    row.step_norm = system.step().Norm();
    // Landmarks that have just gained much, freed of their damping, may go on to: what they are
    // left with under the damping of before is no proof against it.
    if (row.cost_change > context_.stop.Allowed(system.cost())) {
      linearization_.ForgetFreed();
    }
    // Before the step ends, for it asks which factors were touched.
    context_.relinearization.MarkStale(context_.Tolerance());
    system.step().End();
  }
  return moved;
}

// A claim goes first. Those it asks hold more than 3 % of G each; where landmarks that were not
// asked make up most of L, all of more than a share of the mean are, for then no few decide it.
// Without a claim each step of the frames may begin one series of passes, which Step goes on with
// until num_left_ is used up or too little is left. In an Update that is mostly new there are none
// but those of claims.
bool LandmarkPasses::StepBeforeFrames(double gain, double remaining) {
  if (context_.stop.waits_for_landmarks() && num_claims_left_ > 0) {
    --num_claims_left_;
    // Mostly it is those few that have much left.
    const bool many = context_.stop.waits_for_unasked();
    return Pass(many ? ShareOfMean(gain) : context_.tuning.landmarks.deciding_share * gain, gain);
  }
  if (!frames_moved_ || context_.mostly_new ||
      gain <= context_.tuning.landmarks.dominance * remaining) {
    return false;
  }
  frames_moved_ = false;
  num_left_ = context_.options.max_landmark_refinements;
  return Step();
}

}  // namespace inceres::internal
