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
  }
  /// What the landmarks could gain by themselves.
  double Gain() const;
  /// A pass, if any is allowed and they could gain enough. True if any landmark moved.
  bool Step();
  /// The first pass after a step of the frames, if the landmarks hold most of what is left. True as
  /// above.
  bool StepIfTheyDominate(double gain, double remaining);
  void FramesMoved() { frames_moved_ = true; }

 private:
  UpdateContext& context_;
  UpdateLinearization& linearization_;
  bool frames_moved_ = false;  // since landmarks last stepped by themselves
  int num_left_ = 0;           // passes still allowed before the next step of the frames
};

}  // namespace inceres::internal
