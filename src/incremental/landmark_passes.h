#pragma once

#include "incremental/update_context.h"
#include "incremental/update_linearization.h"

namespace inceres::internal {

/// Landmarks that could still gain much by themselves, most of them outliers that a robust loss
/// lets converge slowly, go ahead without the frames: a pass costs their own factors only
/// (docs/algorithms.md, "Landmark refinement").
class LandmarkPasses {
 public:
  LandmarkPasses(UpdateContext* context, UpdateLinearization* linearization)
      : context_(*context), linearization_(*linearization) {}

  /// An Update begins: the frames go first.
  void Begin() {
    frames_moved_ = false;
    num_left_ = 0;
    num_claims_left_ = context_.options.max_landmark_refinements;
  }
  /// What the landmarks could gain by themselves.
  double Gain() const;
  /// A pass, if any is allowed and they could gain enough. True if any landmark moved.
  bool Step();
  /// A pass, if the landmarks hold most of what is left, as is asked once after a step of the
  /// frames, or if a claim of convergence waits for it. True as above.
  bool StepBeforeFrames(double gain, double remaining);
  void FramesMoved() {
    frames_moved_ = true;
    num_claims_left_ = context_.options.max_landmark_refinements;
  }

 private:
  double ShareOfMean(double gain) const;
  bool Pass(double threshold, double gain);

  UpdateContext& context_;
  UpdateLinearization& linearization_;
  bool frames_moved_ = false;  // since landmarks last stepped by themselves
  int num_left_ = 0;           // passes still allowed before the next step of the frames
  int num_claims_left_ = 0;    // the same of those that a claim waits for
};

}  // namespace inceres::internal
