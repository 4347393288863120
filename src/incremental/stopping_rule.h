#pragma once

#include <algorithm>
#include <cmath>

#include "incremental/tuning.h"

namespace inceres::internal {

/// When one Update has found its minimum (docs/algorithms.md, "Stopping rule"). With R the decrease
/// that the model sees left, G what of it landmarks could gain by themselves, and T the tolerance,
/// it ends when
///
///     R + (c − 1) G ≤ σ T,
///     or the steps to come gain little: a R / (1 − φ) + max(4, c) G ≤ T / 2,
///     or the Update before ended by that with R₀ and nothing much has come since,
///     s R₀ / (T / 2) + max(0, R − R₀) / (σ T) ≤ 1 with its s = a / (1 − φ) and G = 0,
///     or so many iterations have together gained no more than T, and R ≤ T.
///
/// c is by how much landmarks gained more than they promised in their last pass, a the same of the
/// last step of the frames, and φ the factor by which what is left fell with it.
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
  void SetRounding(double rounding) { rounding_ = rounding; }
  /// What the first of the tests holds against it.
  double Rest(double remaining, double landmark_gain) const {
    return remaining + (landmark_creep_ - 1.0) * landmark_gain;
  }

  /// What the Update before has left undone, and rightly so, is no reason for a step in this one.
  void GoOnFrom(const StoppingRule& before) { claim_ = before.claim_; }

  /// Whether little is left. Asked once an iteration. An Update that is new for the most part
  /// learns nothing from its last step.
  bool IsLittleLeft(double remaining, double landmark_gain, double cost, int iteration,
                    bool mostly_new);
  /// After a claim that has passed all trust rules: true if no step bears it out. The next claim
  /// then needs that, or a step.
  bool WaitForStep() {
    waits_for_step_ = waits_for_step_ || claims_by_model_;
    return claims_by_model_;
  }
  /// What old Jacobians may err by where that rests on them: T, or a little of it where no step
  /// bears out what they say.
  double ErrorAllowed(double cost) const {
    return (rests_on_nothing_ ? tuning_.nothing_share : 1.0) * Tolerance(cost);
  }
  /// What the iterations that have stagnated have gained, if nothing else says that little is left;
  /// otherwise -1.
  double stagnated_gain() const { return stagnated_gain_; }
  /// Whether a step that is refused with so little left, or that changed the cost by no more than
  /// rounding, proves a minimum.
  bool IsVain(double remaining, double cost_change, double cost) const {
    return std::fabs(cost_change) <= kUnmoved * cost ||
           remaining <= tuning_.rest_share * Tolerance(cost);
  }

  /// A step of the frames was taken of which `remaining` was promised (0: not all of it was taken),
  /// with this gain and gain ratio.
  void StepTaken(double remaining, double gain, double gain_ratio) {
    has_stepped_ = true;
    previous_factor_ = remaining > 0.0 && last_remaining_ > 0.0 ? remaining / last_remaining_ : 0.0;
    last_remaining_ = remaining;
    last_gain_ = gain;
    last_gain_ratio_ = gain_ratio;
    waits_for_step_ = false;
    claim_ = Claim();
  }
  /// What refusals prove is StepControl's to say.
  void StepRefused() { has_refused_ = true; }
  /// Landmarks gained `gain` by themselves where `promise` was seen.
  void LandmarksGained(double gain, double promise) {
    landmark_creep_ = std::max(1.0, gain / promise);
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
  bool NextStepsGainLittle(double remaining, double landmark_gain, double cost, bool is_borne_out);
  bool HasBeenClaimed(double remaining, double landmark_gain, double cost) const;
  bool HasStagnated(double cost, int iteration);

  // Of the cost: a change that is rounding, some half of its last bits.
  static constexpr double kUnmoved = 1e-15;
  // Gain ratio of a step along which the cost is straight: of what its slope promises, the model's
  // curvature takes half. Above that the cost curves downward.
  static constexpr double kCurvesDown = 2.0;

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
  bool has_refused_ = false;
  double last_remaining_ = 0.0;   // 0: of a step that was shortened, or of none
  double previous_factor_ = 0.0;  // by which it had fallen; 0: it is not known
  double last_gain_ = 0.0;
  double last_gain_ratio_ = 1.0;
  double landmark_creep_ = 1.0;  // c
  Claim claim_;
};

}  // namespace inceres::internal
