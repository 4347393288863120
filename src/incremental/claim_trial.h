#pragma once

#include "incremental/tuning.h"

namespace inceres::internal {

/// Whether a claim of the model is to be tried by steps before it counts (docs/algorithms.md,
/// "Stopping rule"). Near a saddle, and wherever the cost is less curved than its model, steps that
/// kept their promise tell of other directions; that one comes to light in small steps alone, in
/// which what is left does not fall. So it has to fall twice, by steps that promise no more than
/// the tolerance, or, where convergence is slow, not to grow in a few of them.
class ClaimTrial {
 public:
  explicit ClaimTrial(const Tuning::Stop& tuning) : tuning_(tuning) {}

  /// An Update begins; `needed`: more has come than variables and factors, so that a minimum of
  /// before may be a saddle by now.
  void Begin(bool needed) {
    needed_ = needed;
    promise_ = 0.0;
    num_steps_ = 0;
  }
  bool is_needed() const { return needed_; }
  /// A step was taken that promised this much, or 0 if it was another than the model wanted.
  void StepTaken(double promise, double gain_ratio);
  /// Whether a claim counts where the model sees this much left. If not, its step is taken.
  bool Holds(double remaining, double tolerance);

 private:
  const Tuning::Stop& tuning_;
  bool needed_ = false;
  double promise_ = 0.0;   // of the last step, if it kept that
  double begun_at_ = 0.0;  // what was left when the trial began
  int num_steps_ = 0;      // taken since, for its sake
  int num_falls_ = 0;      // in a row
};

}  // namespace inceres::internal
