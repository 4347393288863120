#pragma once

#include "inceres/status.h"
#include "incremental/update_context.h"

namespace inceres::internal {

/// Keeps the linearization of an Update up to date, and counts what that takes
/// (docs/algorithms.md, "Relinearization").
class UpdateLinearization {
 public:
  explicit UpdateLinearization(UpdateContext* context) : context_(*context) {}

  /// What is dirty, and S and b with it. False if it failed: the Update is over.
  bool Relinearize();
  /// What is dirty, without its landmarks; false as above.
  bool LinearizeDirty();
  /// Before anything is linearized: what has other weights only is not, unless its old
  /// linearization errs too much for them.
  void LookAtReweighed();

  enum class Freed { kNone, kSome, kFailed };
  /// Far points are damped by more than the frames, or they would run away along their rays: for a
  /// claim they are damped as little, where that shows more to gain than may be left undone, or all
  /// of them where the frames' damping has just been lowered. Once a step, but for `all`; kFailed:
  /// the Update is over.
  Freed FreeHeldLandmarks(bool all, double remaining);
  /// An Update begins, or a step was taken: of the frames, or of landmarks that gained more than
  /// may be left undone.
  void ForgetFreed() { landmarks_freed_ = false; }
  /// DampedSquares::more of a step of the frames; 0: there was none; infinite: it is not known.
  void NoteDampedSquare(double damped_square) { damped_square_ = damped_square; }
  /// Whether landmarks damped by more than the frames may hide more to gain than may be left undone
  /// along a direction that the step noted last has gone, where the model sees this much left.
  bool MayHide(double remaining) const;

  /// Where the batch solver was the last to move: linearizes everything, with the least damping of
  /// landmarks. Between Updates; counted nowhere.
  Status LinearizeAnew();
  /// λ of a landmark that is eliminated now.
  double LandmarkDamping() const;

 private:
  bool MarkHeldLandmarks(bool all, double remaining);
  bool Count(const Status& status, const RelinearizeWork& work);

  UpdateContext& context_;
  bool landmarks_freed_ = false;  // since the last step
  double damped_square_ = 0.0;    // of that
};

}  // namespace inceres::internal
