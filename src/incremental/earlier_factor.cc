// What the factor of S from before the last step says of what is left after it.

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/stopwatch.h"
#include "incremental/incremental_minimizer.h"

namespace inceres::internal {

// A step that kept its promise, on a pose graph, has hardly changed S in the direction that counts:
// b is new, and ½ bᵀS⁻¹b by the factor of before is taken to be right to a factor. Little left is
// then left without a factorization; and of a rest that is small anyway a step by that factor takes
// nearly all. What changed of S waits for the next factorization, which is mostly that of the next
// Update.
IncrementalMinimizer::EarlierFactor IncrementalMinimizer::AskEarlierFactor() {
  const Tuning::EarlierFactor& tuning = tuning_.earlier_factor;
  const double before = std::exchange(state_.left_before_step, 0.0);
  if (!(before > 0.0) || state_.mostly_new || control_.mu() != factored_mu_ ||
      system_.schur().structure().num_landmarks() > 0 || system_.bounds().any()) {
    return EarlierFactor::kSaysNothing;
  }
  {
    const StageTimer timer(&summary_->solve_seconds);
    frame_step_.Refresh(options_.damping, control_.mu(), &system_.schur());
  }
  if (!SeesLeft(0.0)) {
    return EarlierFactor::kSaysNothing;
  }
  const double left = summary_->remaining_decrease;
  if (stop_.IsLittleLeft(tuning.caution * left, 0.0, system_.cost(), summary_->num_iterations,
                         state_.mostly_new)) {
    control_.Sees(left);
    return EarlierFactor::kLittleLeft;
  }
  return left <= std::min(tuning.step_share * Tolerance(), tuning.contraction * before)
             ? EarlierFactor::kStep
             : EarlierFactor::kSaysNothing;
}

// Where only factors have come, on a pose graph, and the last Update left R₀ undone. With H, η
// of before and J, f of the new factors,
//
//     √R = ‖η − Jᵀf‖ / √2 in the norm of (H + JᵀJ)⁻¹  ≤  √R₀ + ‖f‖ / √2,
//
// for Jᵀf is at most ‖f‖ in the norm of (JᵀJ)⁻¹. A robust loss may make Jᵀf larger than its cost
// tells, which is counted twice. Nothing is to be factored for that, nor is it where a pose has
// come along the odometry, where f is 0.
double IncrementalMinimizer::MostLeft() const {
  if (!system_.OnlyGrew() || !std::isfinite(left_) ||
      system_.schur().structure().num_landmarks() > 0 || system_.bounds().any() ||
      control_.mu() != factored_mu_) {
    return HUGE_VAL;
  }
  const double come = std::max(0.0, system_.cost() - left_at_cost_);
  const double root = std::sqrt(left_) + std::sqrt(2.0 * come);
  return root * root;
}

// True if what is left cannot be much, for the same reason.
bool IncrementalMinimizer::LittleHasCome() {
  const double left = std::exchange(state_.left_at_most, HUGE_VAL);
  if (!std::isfinite(left) || state_.mostly_new ||
      !stop_.IsLittleLeft(left, 0.0, system_.cost(), summary_->num_iterations, false)) {
    return false;
  }
  summary_->remaining_decrease = left;
  control_.Sees(left);
  return true;
}

// For AskEarlierFactor, after a step.
void IncrementalMinimizer::NoteStep(double gain_ratio, bool shortened) {
  const bool kept = !shortened && std::fabs(gain_ratio - 1.0) <= tuning_.earlier_factor.kept;
  state_.left_before_step = kept ? summary_->remaining_decrease : 0.0;
}

}  // namespace inceres::internal
