#pragma once

#include <cmath>

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
  /// An Update begins. Of one that goes on from another solver's steps nothing is known.
  void BeginToLook(bool knows_nothing) { NoteStep(knows_nothing ? HUGE_VAL : 0.0, 0.0); }
  /// The whole step of the frames, and DampedLandmarks::held_back of what of it is taken.
  void NoteStep(double held_back_of_landmarks) {
    NoteStep(step_.ScaledSquare(), held_back_of_landmarks);
  }
  /// Whether damping may hide more to gain than may be left undone along a direction that the step
  /// noted last has gone.
  bool MayHide() const;
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
  void NoteStep(double scaled_square, double held_back_of_landmarks) {
    scaled_square_ = scaled_square;
    held_back_of_landmarks_ = held_back_of_landmarks;
  }

  UpdateContext& context_;
  FrameStep step_;
  double factored_mu_ = -1.0;   // of the factor there is
  double scaled_square_ = 0.0;  // δᵀ diag C δ of the step noted last
  double held_back_of_landmarks_ = 0.0;
};

}  // namespace inceres::internal
