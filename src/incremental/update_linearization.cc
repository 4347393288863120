#include "incremental/update_linearization.h"

#include <algorithm>
#include <vector>

#include "base/stopwatch.h"

namespace inceres::internal {

// λ = max(μ, λ_min): a far point must not run off along its ray while the frames are hardly damped.
// Where it had to be allowed to, for a claim, it is μ until a step is taken: were landmarks damped
// by λ_min again as soon as a step is refused, the refusal would tell nothing of what is left then.
double UpdateLinearization::LandmarkDamping() const {
  const double mu = context_.control.mu();
  const double least = landmarks_freed_ ? mu : context_.tuning.landmarks.min_damping;
  return context_.options.damping == DampingForm::kThesis ? 0.0 : std::max(mu, least);
}

bool UpdateLinearization::Relinearize() {
  const StageTimer timer(&context_.summary->linearize_seconds);
  // Landmarks that refusals have damped hard come back once μ has come down; those that are damped
  // a little more than today are left, for a change of λ costs an elimination.
  context_.system.RedampAbove(context_.tuning.landmarks.outdated_damping * LandmarkDamping());
  RelinearizeWork work;
  const Status status =
      context_.system.Relinearize(LandmarkDamping(), context_.options.rebuild, &work);
  return Count(status, work);
}

bool UpdateLinearization::LinearizeDirty() {
  const StageTimer timer(&context_.summary->linearize_seconds);
  RelinearizeWork work;
  const Status status = context_.system.LinearizeDirty(&work);
  return Count(status, work);
}

void UpdateLinearization::LookAtReweighed() {
  const StageTimer timer(&context_.summary->linearize_seconds);
  const std::vector<FactorRef>& reweighed = context_.system.Reweigh();
  context_.summary->num_reweighed_factors += static_cast<int>(reweighed.size());
  if (!reweighed.empty()) {
    context_.relinearization.LookAt(reweighed, context_.Tolerance());
  }
}

// Counted after a failure as well: the work was done.
bool UpdateLinearization::Count(const Status& status, const RelinearizeWork& work) {
  UpdateSummary& summary = *context_.summary;
  summary.num_relinearized_factors += work.num_factors;
  summary.num_recentered_factors += work.num_recentered;
  summary.num_eliminated_landmarks += work.num_landmarks;
  summary.num_rebuilds += work.rebuilt ? 1 : 0;
  summary.num_drifted_frames += work.num_drifted_frames;
  if (!status.ok()) {
    context_.Finish(Termination::kFailure, status.message.c_str());
  }
  return status.ok();
}

// Along a direction with a gradient g, in which H is as stiff as s, there is ½ g² / (s + μ) to gain
// with a damping of μ. With λ in its place the step is δ = g / (s + λ): where s is small beside λ,
// g is λδ, and ½ (λδ)² / μ the most that is hidden: of what is worth it to look for, whatever μ the
// frames happen to have. R has ½ (λδ)² / λ of it, at least.
bool UpdateLinearization::MayHide(double remaining) const {
  const Tuning::Landmarks& landmarks = context_.tuning.landmarks;
  const double least = landmarks.least_seen * landmarks.min_damping;
  const double damped_square = std::min(damped_square_, 2.0 * LandmarkDamping() * remaining);
  return 0.5 * damped_square > least * context_.tuning.stop.rest_share * context_.Tolerance();
}

// All of them, or those that would go by themselves.
bool UpdateLinearization::MarkHeldLandmarks(bool all, double remaining) {
  const double mu = context_.control.mu();
  return all || MayHide(remaining)
             ? context_.system.RedampAll(mu)
             : context_.system.RedampHidden(mu, context_.stop.Allowed(context_.system.cost()));
}

UpdateLinearization::Freed UpdateLinearization::FreeHeldLandmarks(bool all, double remaining) {
  if ((landmarks_freed_ && !all) || !MarkHeldLandmarks(all, remaining)) {
    return Freed::kNone;
  }
  const StageTimer timer(&context_.summary->linearize_seconds);
  // A second time would find the same until a step is taken.
  landmarks_freed_ = true;
  context_.row().refreshed = true;
  RelinearizeWork work;
  const Status status =
      context_.system.Relinearize(context_.control.mu(), context_.options.rebuild, &work);
  return Count(status, work) ? Freed::kSome : Freed::kFailed;
}

// For covariances: with λ_min, whatever μ has been.
Status UpdateLinearization::LinearizeAnew() {
  const double damping = context_.options.damping == DampingForm::kThesis
                             ? 0.0
                             : context_.tuning.landmarks.min_damping;
  RelinearizeWork work;
  return context_.system.Relinearize(damping, context_.options.rebuild, &work);
}

}  // namespace inceres::internal
