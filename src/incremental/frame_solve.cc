#include "incremental/frame_solve.h"

#include <algorithm>

#include "base/stopwatch.h"

namespace inceres::internal {

// A share of T for all frames together, so that what the substitution leaves stays below it.
double FrameSolve::Wildfire() const {
  return context_.tuning.truncate.wildfire_share * context_.Tolerance() /
         std::max(1, context_.system.schur().structure().num_frames());
}

Status FrameSolve::Factorize() {
  const StageTimer timer(&context_.summary->solve_seconds);
  // An earlier factor is asked only as long as μ is still that of the factor.
  factored_mu_ = context_.control.mu();
  return step_.Factorize(context_.options.damping, context_.control.mu(), &context_.system.schur(),
                         context_.trace);
}

Status FrameSolve::Solve() {
  const StageTimer timer(&context_.summary->solve_seconds);
  return step_.Solve(Wildfire(), &context_.system.schur(), context_.trace);
}

// What the model promises for the whole step is known from the forward substitution alone, where
// the solver can say so: R = ½ yᵀy and the landmarks' part.
bool FrameSolve::SeesLeft(double landmark_gain) {
  const StageTimer timer(&context_.summary->solve_seconds);
  // ½ bᵀδ_c = ½ ‖L⁻¹b‖², which takes no backward substitution.
  double gain = 0.0;
  const bool sees = step_.FindGain(&context_.system.schur(), &gain);
  context_.summary->remaining_decrease = landmark_gain + gain;
  return sees;
}

// Along a direction with a gradient g, in which S is as stiff as s, the step is δ = g / (s + μ) and
// damping takes part with h = μδ². All that there is to gain, ½ g² / s, is ½ h (s + μ)² / (μ s):
// where s is small beside μ, ½ h μ / s. Long chains without landmarks have many directions of s
// somewhat above μ, in which h is much less than 2R, and nothing hides.
bool FrameSolve::MayHide() const {
  const Tuning::Stop& tuning = context_.tuning.stop;
  const double held_back = context_.control.mu() * scaled_square_ + held_back_of_landmarks_;
  const bool is_most = context_.system.schur().structure().num_landmarks() > 0 ||
                       held_back >= context_.summary->remaining_decrease;
  return context_.options.damping == DampingForm::kHybrid && is_most &&
         0.5 * held_back > tuning.below_floor * tuning.rest_share * context_.Tolerance();
}

void FrameSolve::Refresh() {
  const StageTimer timer(&context_.summary->solve_seconds);
  step_.Refresh(context_.options.damping, context_.control.mu(), &context_.system.schur());
}

}  // namespace inceres::internal
