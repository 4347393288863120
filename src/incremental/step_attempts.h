#pragma once

#include "incremental/frame_step.h"
#include "incremental/update_context.h"

namespace inceres::internal {

/// Tries the step that the active set has set, within the trust region once there is one, and
/// takes it (docs/algorithms.md, "Damping and trust region of incremental mode").
class StepAttempts {
 public:
  StepAttempts(UpdateContext* context, FrameStep* frame_step)
      : context_(*context), frame_step_(*frame_step) {}

  /// A step that is refused with no old Jacobian to blame is tried again along the dog-leg path:
  /// that costs an evaluation, where more damping costs a factorization too. True if it was taken,
  /// and its gain ratio; `refreshed`: old Jacobians are to be renewed first.
  bool Take(bool* refreshed, double* gain_ratio);
  /// The step as it is set; false if it could not be evaluated.
  bool Evaluate(double* gain_ratio);
  /// It moves the state, and what it touched is looked at.
  void Accept();

 private:
  UpdateContext& context_;
  FrameStep& frame_step_;
};

}  // namespace inceres::internal
