#include "incremental/earlier_factor.h"

#include <algorithm>
#include <utility>

#include "base/stopwatch.h"

namespace inceres::internal {

void EarlierFactor::Begin(bool alone) {
  left_before_step_ = 0.0;
  left_at_most_ = alone ? MostLeft() : HUGE_VAL;
  left_ = HUGE_VAL;
}

void EarlierFactor::End(bool converged) {
  left_ = HUGE_VAL;
  if (converged) {
    left_ = context_.summary->remaining_decrease;
    left_at_cost_ = context_.system.cost();
    context_.system.WatchGrowth();
  }
}

// Whether the factor there is, and a promise by it, are of the graph as it moves now.
bool EarlierFactor::KnowsGraph() const {
  return frame_step_.HasDampingOfNow() &&
         context_.system.schur().structure().num_landmarks() == 0 &&
         !context_.system.bounds().any();
}

// A step that kept its promise, on a pose graph, has hardly changed S in the direction that counts:
// b is new, and ½ bᵀS⁻¹b by the factor of before is taken to be right to a factor. Little left is
// then left without a factorization; and of a rest that is small anyway a step by that factor takes
// nearly all. What changed of S waits for the next factorization, which is mostly that of the next
// Update.
EarlierFactor::Verdict EarlierFactor::Ask() {
  const Tuning::EarlierFactor& tuning = context_.tuning.earlier_factor;
  const double before = std::exchange(left_before_step_, 0.0);
  if (!(before > 0.0) || context_.mostly_new || !KnowsGraph()) {
    return Verdict::kSaysNothing;
  }
  {
    const StageTimer timer(&context_.summary->solve_seconds);
    frame_step_.Refresh();
  }
  if (!frame_step_.SeesLeft(0.0)) {
    return Verdict::kSaysNothing;
  }
  const double left = context_.summary->remaining_decrease;
  if (context_.IsLittleLeft(tuning.caution * left, 0.0)) {
    context_.control.Sees(left);
    return Verdict::kLittleLeft;
  }
  return left <= std::min(tuning.step_share * context_.Tolerance(), tuning.contraction * before)
             ? Verdict::kStep
             : Verdict::kSaysNothing;
}

// Where only factors have come, on a pose graph, and the last Update left R₀ undone. With H, η
// of before and J, f of the new factors,
//
//     √R = ‖η − Jᵀf‖ / √2 in the norm of (H + JᵀJ)⁻¹  ≤  √R₀ + ‖f‖ / √2,
//
// for Jᵀf is at most ‖f‖ in the norm of (JᵀJ)⁻¹. A robust loss may make Jᵀf larger than its cost
// tells, which is counted twice. Nothing is to be factored for that, nor is it where a pose has
// come along the odometry, where f is 0.
double EarlierFactor::MostLeft() const {
  if (!context_.system.OnlyGrew() || !std::isfinite(left_) || !KnowsGraph()) {
    return HUGE_VAL;
  }
  const double come = std::max(0.0, context_.system.cost() - left_at_cost_);
  const double root = std::sqrt(left_) + std::sqrt(2.0 * come);
  return root * root;
}

// For the reason that MostLeft gives.
bool EarlierFactor::LittleHasCome() {
  const double left = std::exchange(left_at_most_, HUGE_VAL);
  if (!std::isfinite(left) || context_.mostly_new || !context_.IsLittleLeft(left, 0.0)) {
    return false;
  }
  context_.summary->remaining_decrease = left;
  context_.control.Sees(left);
  context_.control.NoteDampedSquare(0.0);  // the Update before has looked at what was hidden
  return true;
}

// What a step has left is foreseen, and b not looked at where that is too much for either verdict
// of Ask. A step that was off by a share of e of its promise leaves about as much of it; and what
// is left goes on to fall as it has fallen.
bool EarlierFactor::LeavesMuch(double promised, double error) const {
  const Tuning::EarlierFactor& tuning = context_.tuning.earlier_factor;
  const double T = context_.Tolerance();
  const double factor = context_.stop.factor_of_last_step();
  return error * promised > tuning.worth_asking * T ||
         (factor > tuning.contraction && factor * promised > T);
}

void EarlierFactor::NoteStep(double gain_ratio, bool shortened) {
  const double promised = context_.summary->remaining_decrease;
  const double error = std::fabs(gain_ratio - 1.0);
  const bool is_worth_asking =
      !shortened && error <= context_.tuning.earlier_factor.kept && !LeavesMuch(promised, error);
  left_before_step_ = is_worth_asking ? promised : 0.0;
}

}  // namespace inceres::internal
