#pragma once

#include <algorithm>
#include <cmath>

#include "incremental/tuning.h"

namespace inceres::internal {

/// When one Update has found its minimum (docs/algorithms.md, "Stopping rule"). With R the decrease
/// that the model sees left, G what of it landmarks could gain by themselves, and T the tolerance,
/// it ends when
///
///     R ≤ σ T and R + L ≤ T / 2,
///     or the steps to come gain little: a R / (1 − φ) + L ≤ T / 2,
///     or the Update before ended by that with R₀ and nothing much has come since,
///     s R₀ / (T / 2) + max(0, R − R₀) / (σ T) ≤ 1 with its s = a / (1 − φ) and G = 0,
///     or so many iterations have together gained no more than T, and R ≤ T.
///
/// L is what landmarks could gain by themselves beyond G, by the curvatures that their last pass
/// has shown; if the frames have moved since, it may be anything, or 15 G where G ≤ 10⁻³ T. a is by
/// how much the last step of the frames gained more than it promised, and φ the factor by which
/// what is left fell with it.
class StoppingRule {
 public:
  StoppingRule() = default;
  /// For an Update that begins at this cost, of which a part is fixed and at most so much is
  /// rounding, with this iteration.
  StoppingRule(const Tuning::Stop& tuning, double function_tolerance, double fixed_cost,
               double most_rounding, int iteration, double cost)
      : tuning_(tuning),
        function_tolerance_(function_tolerance),
        fixed_cost_(fixed_cost),
        most_rounding_(most_rounding),
        rounding_(most_rounding),
        checked_iteration_(iteration),
        checked_cost_(cost) {}

  /// T: cost changes below it do not count. The user's tolerance times what can change of the cost,
  /// and where that is next to zero the rounding of the residuals.
  double Tolerance(double cost) const {
    return std::max(OfFunction(cost), rounding_ / tuning_.share);
  }
  /// σ T: what an Update may leave undone.
  double Allowed(double cost) const { return tuning_.share * Tolerance(cost); }
  double rounding() const { return rounding_; }
  /// Whether it depends on how much of the cost is rounding if no more than this is little; that is
  /// then to be set, as far as it counts.
  bool AsksForRounding(double remaining, double cost) const {
    const double most = most_rounding_ / tuning_.share;
    return most > OfFunction(cost) && remaining <= most;
  }
  /// Whether the tolerance is made of rounding, and so is what is left.
  bool IsRounding(double remaining, double cost) const {
    return rounding_ > tuning_.share * OfFunction(cost) && remaining <= rounding_;
  }
  void SetRounding(double rounding) { rounding_ = rounding; }

  /// What the Update before has left undone, and rightly so, is no reason for a step in this one;
  /// but where values or functions were written or factors removed no step has led, and one is to
  /// bear out what the model says.
  void GoOnFrom(const StoppingRule& before, bool is_rewritten) {
    asks_for_step_ = is_rewritten;
    claim_ = is_rewritten ? Claim() : before.claim_;
  }

  /// Whether little is left. Asked once an iteration. An Update that is new for the most part
  /// learns nothing from its last step.
  bool IsLittleLeft(double remaining, double landmark_gain, double cost, int iteration,
                    bool mostly_new);
  /// Whether a pass of the landmarks is all that it takes to tell: if they have as little left as
  /// their model says, little is left. Of the last time that was asked.
  bool waits_for_landmarks() const { return waits_for_landmarks_; }
  /// The same, and a pass has told that they have more left.
  bool sees_landmarks_creep() const { return waits_for_landmarks_ && landmarks_left_ >= 0.0; }
  /// The same, and most of that is what those may have that were not asked.
  bool waits_for_unasked() const { return sees_landmarks_creep() && unasked_decide_; }
  /// After a claim that has passed all trust rules: true if no step bears it out. The next claim
  /// then needs that, or a step.
  bool WaitForStep() {
    waits_for_step_ = waits_for_step_ || claims_by_model_;
    return claims_by_model_;
  }
  bool waits_for_step() const { return waits_for_step_; }
  /// Steps were damped hard, and are so no more: what those have gained tells nothing of the next.
  void CountStepsFrom(int iteration, double cost) {
    checked_iteration_ = iteration;
    checked_cost_ = cost;
  }
  /// What old Jacobians may err by where that rests on them: T, or a little of it where no step
  /// bears out what they say, or WasOff.
  double ErrorAllowed(double cost, double share_if_off) const {
    const double share = rests_on_nothing_ ? tuning_.nothing_share : WasOff() ? share_if_off : 1.0;
    return share * Tolerance(cost);
  }
  /// Whether a step was refused, or off from its promise by more than half, or what was left had
  /// fallen slowly with the last one: that next to nothing is left is then not for old Jacobians to
  /// say.
  bool WasOff() const { return was_off_ || previous_factor_ > tuning_.steady_factor; }
  /// A step was refused, whatever its length.
  void StepRefused() { was_off_ = true; }
  /// What the iterations that have stagnated have gained, if nothing else says that little is left;
  /// otherwise -1.
  double stagnated_gain() const { return stagnated_gain_; }
  /// φ of the last two steps, by which what is left has fallen; 0: not known.
  double factor_of_last_step() const { return previous_factor_; }
  /// Whether a step that is refused with so little left, or that changed the cost by no more than
  /// rounding where no more than the tolerance is left, proves a minimum. A step that promised much
  /// and changed nothing went too far: to where nothing depends on a variable.
  bool IsVain(double remaining, double cost_change, double cost) const {
    return (std::fabs(cost_change) <= kUnmoved * cost && remaining <= Tolerance(cost)) ||
           (!sees_landmarks_creep() && IsBorneOut(remaining, cost) &&
            remaining <= tuning_.rest_share * Tolerance(cost));
  }

  /// A step of the frames was taken of which `remaining` was promised (0: not all of it was taken),
  /// with this gain and gain ratio.
  void StepTaken(double remaining, double gain, double gain_ratio) {
    has_stepped_ = true;
    has_curved_down_ = has_curved_down_ || gain_ratio > kCurvesDown;
    was_off_ = was_off_ || std::fabs(gain_ratio - 1.0) > kOff;
    previous_factor_ = remaining > 0.0 && last_remaining_ > 0.0 ? remaining / last_remaining_ : 0.0;
    last_remaining_ = remaining;
    last_gain_ = gain;
    last_gain_ratio_ = gain_ratio;
    waits_for_step_ = false;
    landmarks_left_ = -1.0;
    landmarks_gained_ = 0.0;
    claim_ = Claim();
  }
  /// Landmarks have stepped by themselves with this gain, and have so much left; others were
  /// promised `unasked`, and not asked.
  void LandmarksStepped(double gain, double left, double unasked) {
    landmarks_gained_ += gain;
    const double rest = (tuning_.creeping_landmarks - 1.0) * std::max(0.0, unasked);
    landmarks_left_ = left + rest;
    unasked_decide_ = rest > left;
  }

 private:
  // What the model saw left when the steps to come were last found to gain little, and times what
  // they were taken to gain.
  struct Claim {
    double remaining = 0.0;
    double series = 0.0;
  };

  double OfFunction(double cost) const { return function_tolerance_ * (cost - fixed_cost_); }
  bool IsBorneOut(double remaining, double cost) const;
  double LandmarkRest(double landmark_gain, double cost) const;
  bool IsSmall(double remaining, double landmark_rest, double cost) const;
  double SeriesOfSteps(double remaining) const;
  bool NextStepsGainLittle(double series, double landmark_rest, double cost) const;
  bool HasBeenClaimed(double remaining, double landmark_gain, double cost) const;
  bool HasStagnated(double cost, int iteration);

  // Of the cost: a change that is rounding, some half of its last bits.
  static constexpr double kUnmoved = 1e-15;
  // Gain ratio of a step along which the cost is straight: of what its slope promises, the model's
  // curvature takes half. Above that the cost curves downward.
  static constexpr double kCurvesDown = 2.0;
  // Of a step that gained less than half of what it promised, for the cost curves upward there.
  static constexpr double kCurvesUp = 0.5;
  // Of its promise.
  static constexpr double kOff = 0.5;

  Tuning::Stop tuning_;
  double function_tolerance_ = 0.0;
  double fixed_cost_ = 0.0;
  double most_rounding_ = 0.0;
  double rounding_ = 0.0;      // of the residuals, when they were last looked at
  int checked_iteration_ = 0;  // from which on HasStagnated counts
  double checked_cost_ = 0.0;  // then
  double stagnated_gain_ = -1.0;
  bool rests_on_nothing_ = false;  // there is nothing left, as far as the model alone tells
  bool claims_by_model_ = false;   // alone: no step bears it out
  bool waits_for_step_ = false;    // to bear out what has been claimed
  bool has_stepped_ = false;
  bool has_curved_down_ = false;  // along one of its steps
  bool was_off_ = false;          // one of its steps
  bool asks_for_step_ = false;    // before the first one, too
  double last_remaining_ = 0.0;   // 0: of a step that was shortened, or of none
  double previous_factor_ = 0.0;  // by which it had fallen; 0: it is not known
  double last_gain_ = 0.0;
  double last_gain_ratio_ = 1.0;
  double landmarks_left_ = -1.0;   // L; negative: the frames have moved since
  double landmarks_gained_ = 0.0;  // since then
  bool unasked_decide_ = false;
  bool landmarks_have_crept_ = false;
  bool waits_for_landmarks_ = false;
  Claim claim_;
};

}  // namespace inceres::internal
