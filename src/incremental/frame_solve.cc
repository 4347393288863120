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

void FrameSolve::Refresh() {
  const StageTimer timer(&context_.summary->solve_seconds);
  step_.Refresh(context_.options.damping, context_.control.mu(), &context_.system.schur());
}

}  // namespace inceres::internal
