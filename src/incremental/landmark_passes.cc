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
  IncrementalSystem& system = context_.system;
  const double share = context_.tuning.landmarks.share;
  const double gain = Gain();
  if (num_left_ <= 0 || gain <= share * context_.stop.Allowed(system.cost())) {
    return false;
  }
  --num_left_;
  UpdateSummary& summary = *context_.summary;
  const StageTimer timer(&summary.landmark_seconds);
  const double cost = system.cost();
  int num_evaluated = 0;
  // Those step whose own gain exceeds a share of the mean: a few outliers mostly hold nearly all of
  // it.
  const int count = std::max(1, system.schur().structure().num_landmarks());
  const bool moved =
      system.StepLandmarks(system.schur().gains().Above(share * gain / count), &num_evaluated);
  ++summary.num_landmark_refinements;
  summary.num_evaluated_factors += num_evaluated;
  if (moved) {
    UpdateIteration& row = context_.row();
    row.step = UpdateStep::kLandmarks;
    row.step_is_successful = true;
    row.cost_change = cost - system.cost();
    // c of the stopping rule: what landmarks gain over their promise, they may go on to gain.
    context_.stop.LandmarksGained(row.cost_change, gain);
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

bool LandmarkPasses::StepIfTheyDominate(double gain, double remaining) {
  if (!frames_moved_ || context_.mostly_new ||
      gain <= context_.tuning.landmarks.dominance * remaining) {
    return false;
  }
  frames_moved_ = false;
  num_left_ = context_.options.max_landmark_refinements;
  return Step();
}

}  // namespace inceres::internal
