#pragma once

#include "inceres/solver/summary.h"
#include "trust_region/loop_evaluation.h"
#include "trust_region/step_trial.h"

namespace inceres::internal {

/// The linear solve of an iteration of the trust-region loop: the strategy's step, counted and
/// timed, shown to who looks at linear systems, and refused where its model promises nothing.
class StepSolve {
 public:
  /// The strategy may be made later.
  StepSolve(const LoopParts& parts, StepTrial* trial) : parts_(parts), trial_(*trial) {}

  /// Writes the trial's step. Whether it is valid the iteration tells. False: the solve has ended,
  /// for reasons that have nothing to do with numbers.
  bool Run(IterationSummary* iteration);
  /// After a step that is not valid. False: it was one too many in a row, and the solve has ended.
  bool GoOnWithout();

  /// Steps that were not valid, since the last one that was.
  int num_invalid() const { return num_invalid_; }
  void set_num_invalid(int num_invalid) { num_invalid_ = num_invalid; }

 private:
  void Count(int num_solves, IterationSummary* iteration);
  void ShowSystem(int iteration) const;

  const LoopParts& parts_;
  StepTrial& trial_;
  int num_invalid_ = 0;
  int num_empty_ = 0;  // of these, with a step that promises nothing
};

}  // namespace inceres::internal
