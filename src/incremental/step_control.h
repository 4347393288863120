#pragma once

#include <cmath>

#include "inceres/solver/incremental_options.h"
#include "incremental/tuning.h"

namespace inceres::internal {

/// The damping μ and the radius of the trust region (docs/algorithms.md, "Damping and trust region
/// of incremental mode"), and what refused steps prove. μ is kept from one Update to the next; it
/// hides what weak directions could gain, so that convergence is claimed at its floor only.
class StepControl {
 public:
  /// For an Update that begins with this damping, clamped to what the options allow.
  StepControl(const Tuning& tuning, const IncrementalOptions& options, double mu);

  double mu() const { return mu_; }
  /// In the norm ‖Dδ‖; infinite unless a step was refused or poor.
  double radius() const { return radius_; }
  /// Whether μ is so far from its floor that what is left cannot be seen.
  bool IsDampedHard() const { return mu_ > stop_.fine_damping * floor_; }
  /// Whether a step keeps so much of its promise that the radius may grow: an infinite one need not
  /// know its length.
  bool IsGood(double gain_ratio) const { return gain_ratio > tuning_.good_ratio; }

  /// With the damping there is now the model sees this much left.
  void Sees(double remaining) {
    if (!IsDampedHard()) {
      remaining_at_floor_ = remaining;
      gained_since_floor_ = 0.0;
    }
  }

  /// A step of this length was accepted: the radius follows its gain ratio.
  void AdaptRadius(double gain_ratio, double norm);
  /// A refused step is tried again: returns the length.
  double Shorten(double norm) { return radius_ = tuning_.shortening * norm; }
  bool MayShorten(int attempt) const { return attempt < tuning_.max_shortenings; }
  /// The damping takes over.
  void GiveUpRadius() { radius_ = HUGE_VAL; }

  /// A step was taken: Nielsen's rule, by which μ falls to a third at best. `shortened`: by the
  /// radius.
  void Accept(double gain_ratio, double gain, bool shortened);
  /// μ grows. `blindly`: a cost function refused to evaluate the step. False if it may not grow
  /// further.
  bool Refuse(double remaining, bool blindly);

  /// Before success the damping goes to its floor, once only while no step is taken there and those
  /// taken with more have gained no more than the tolerance together: where steps are refused it
  /// grows again. True if it was lowered.
  bool RelaxOnce(double tolerance);
  /// That has been done, steps were refused, and a claim rests on JudgeRefusals.
  bool RefusalsDecide() const { return relaxed_ && IsDampedHard(); }
  /// DampedSquares::like_frames of a step that is taken, or looked at.
  void NoteDampedSquare(double square) { damped_square_ = square; }
  /// Whether directions weaker than μ may hide more than `little`, where the model sees this much
  /// left.
  bool MayHide(double remaining, double little) const;
  /// Where they may, the damping goes to a share of its floor: once until a step is taken.
  bool LowerOnce(double remaining, double little);
  enum class Verdict { kMinimum, kRefusals, kUnknown, kTryBetween };
  /// Steps were refused, up to the damping at which nothing is left to gain. That is the minimum if
  /// little was left at the floor, too. Otherwise all that speaks for it are the refusals: as far
  /// as steps between the last two dampings, one of which is then to be tried, could not gain more
  /// than the tolerance either. Of what a cost function refused to evaluate nothing is known.
  Verdict JudgeRefusals(double tolerance);

 private:
  Tuning::Retreat tuning_;
  Tuning::Stop stop_;
  double least_damping_;
  double max_damping_;
  double floor_;  // of μ: min_damping, or least_damping_ since weak directions have been looked for
  double mu_;
  double nu_ = 2.0;
  double radius_ = HUGE_VAL;
  int num_shortened_ = 0;  // accepted steps in a row that the radius has shortened
  // μ went to its floor to prove convergence, and no step was taken there since
  bool relaxed_ = false;
  double damped_square_ = HUGE_VAL;       // of the step noted last, in this Update
  bool lowered_ = false;                  // below the floor, since a step was taken
  double remaining_at_floor_ = HUGE_VAL;  // what was left when μ was last at its floor
  double gained_since_floor_ = 0.0;
  // when a step was last refused; infinite: not since one was taken at the floor
  double remaining_when_refused_ = HUGE_VAL;
  double refused_mu_;             // of that step
  bool refused_blindly_ = false;  // a cost function refused to evaluate one of those steps
};

}  // namespace inceres::internal
