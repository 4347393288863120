#pragma once

#include "inceres/status.h"
#include "incremental/frame_step.h"
#include "incremental/update_context.h"

namespace inceres::internal {

/// The reduced system of an Update: factors it, tells what it leaves to gain, solves it, with the
/// damping of the moment, and times that.
class FrameSolve {
 public:
  explicit FrameSolve(UpdateContext* context)
      : context_(*context), step_(context->options, context->system.executor()) {}

  /// kSingular if there is no factor.
  Status Factorize();
  /// δ_c
  Status Solve();
  /// What the model promises for the whole step, all of it still undone, goes into the summary;
  /// `landmark_gain` is the landmarks' part. False: not before the step is known.
  bool SeesLeft(double landmark_gain);
  /// Takes over changes of S and b only.
  void Refresh();
  /// Factors S with the least damping, between Updates; counted nowhere.
  Status FactorizeAnew() {
    return step_.FactorizeOnly(context_.options.damping, context_.options.min_damping,
                               &context_.system.schur());
  }
  /// Whether the factor there is has the damping of now.
  bool HasDampingOfNow() const { return context_.control.mu() == factored_mu_; }
  /// What a change of a frame's step must be worth to be noticed.
  double Wildfire() const;

  FrameStep& step() { return step_; }
  const FrameStep& step() const { return step_; }

 private:
  UpdateContext& context_;
  FrameStep step_;
  double factored_mu_ = -1.0;  // of the factor there is
};

}  // namespace inceres::internal
