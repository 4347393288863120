#include "incremental/landmark_passes.h"

#include <algorithm>

#include "base/stopwatch.h"

namespace inceres::internal {

// The sum is kept by difference, and summed anew where rounding may have eaten a share of what the
// Update may leave.
double LandmarkPasses::Gain() const {
  return context_.system.schur().gains().Total(context_.tuning.truncate.sum_share *
                                               context_.stop.Allowed(context_.system.cost()));
}

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
