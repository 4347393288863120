#pragma once

#include <string>

#include "incremental/update_context.h"
#include "incremental/update_linearization.h"

namespace inceres::internal {

/// Ceres's verdicts on the gradient and on the step, beside that on the cost: as the options ask
/// for them, by default not at all.
class UpdateTolerances {
 public:
  UpdateTolerances(UpdateContext* context, UpdateLinearization* linearization)
      : context_(*context), linearization_(*linearization) {}

  /// Whether the gradient or the last step is as small as the options ask for, or Jacobians that
  /// were renewed to see that have failed; the Update has then ended, with the reason in its
  /// summary.
  bool EndUpdate();
  /// The norm of the last step and of what it left out; negative: there was none, or it does not
  /// count.
  void NoteStep(double norm) { whole_step_ = norm; }

 private:
  bool EndByStep();
  bool EndByGradient();
  bool Converged(const std::string& message);
  bool MarkOld();
  double GradientMaxNorm() const;

  UpdateContext& context_;
  UpdateLinearization& linearization_;
  double whole_step_ = -1.0;
};

}  // namespace inceres::internal
