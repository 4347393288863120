#pragma once

#include <cmath>

#include "incremental/frame_step.h"
#include "incremental/update_context.h"

namespace inceres::internal {

/// What is known of the rest without a factorization, on a graph without landmarks: by the factor
/// of S from before the last step, or from what the last Update left undone (docs/algorithms.md,
/// "Stopping rule").
class EarlierFactor {
 public:
  // Says nothing: S is to be factored; little is left; or a step by it does.
  enum class Verdict { kSaysNothing, kLittleLeft, kStep };

  EarlierFactor(UpdateContext* context, FrameStep* frame_step)
      : context_(*context), frame_step_(*frame_step) {}

  /// An Update begins, with all that has come linearized; `alone`: nobody has stepped in it before.
  void Begin(bool alone);
  /// It has ended, with convergence or without.
  void End(bool converged);

  /// After a step that kept its promise.
  Verdict Ask();
  /// Before the first step: true if what is left cannot be much. Asked once an Update.
  bool LittleHasCome();
  /// After a step, shortened or not.
  void NoteStep(double gain_ratio, bool shortened);

 private:
  bool LeavesMuch(double promised, double error) const;
  bool KnowsGraph() const;
  double MostLeft() const;

  UpdateContext& context_;
  FrameStep& frame_step_;
  double left_at_most_ = HUGE_VAL;  // before the first step, as far as the last Update tells
  // By the model, of a step that kept its promise and may have left little; else 0.
  double left_before_step_ = 0.0;
  // What the last Update left undone, and at which cost; infinite: it did not converge.
  double left_ = HUGE_VAL;
  double left_at_cost_ = 0.0;
};

}  // namespace inceres::internal
