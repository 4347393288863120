#pragma once

#include "incremental/frame_step.h"
#include "incremental/index_set.h"
#include "incremental/partial_step.h"
#include "incremental/step_attempts.h"
#include "incremental/update_context.h"
#include "incremental/update_linearization.h"

namespace inceres::internal {

/// Steps of frames that have just come, with the landmarks they see, all other frames held
/// (docs/algorithms.md, "Steps of new frames").
class NewFrameSteps {
 public:
  NewFrameSteps(UpdateContext* context, UpdateLinearization* linearization, FrameStep* frame_step,
                StepAttempts* attempts)
      : context_(*context),
        linearization_(*linearization),
        frame_step_(*frame_step),
        attempts_(*attempts),
        partial_step_(context->tuning.truncate) {}

  /// Takes note of the frames that have come since the last Update; whether they step first.
  bool AreWorthwhile();
  /// They step. At least one iteration is left to the others. False if the Update ends: with an
  /// error, or because the observer says so.
  bool Run();
  std::size_t Bytes() const { return partial_step_.Bytes(); }

 private:
  bool FindStep();
  void NameLandmarks();

  UpdateContext& context_;
  UpdateLinearization& linearization_;
  FrameStep& frame_step_;
  StepAttempts& attempts_;
  IndexSet frames_;     // since the last Update
  IndexSet landmarks_;  // seen from them
  PartialStep partial_step_;
};

}  // namespace inceres::internal
