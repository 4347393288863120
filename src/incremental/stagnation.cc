#include "incremental/stagnation.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

#include "base/formatted.h"

// When Marquardt's rule has come to its end without convergence by the model (docs/algorithms.md,
// "One-time solves and exact windows", verdicts). Two counts run side by side. costs_ has the cost
// after each of the last taken steps: if those together bring next to nothing, a proof begins,
// from a small damping anew, and only if that does not help either is the end proven.
// num_since_gain_ counts all iterations, refused ones too, since the cost last fell noticeably:
// when damping has gone through all lengths of steps in vain, that is the end by refusals, unless
// little damping was never tried.

namespace inceres::internal {
namespace {

// A step of which less than this was taken tells of a border, not of what is left to gain.
constexpr double kLargeShare = 0.25;

// Between two dampings that are tried one after the other at a border.
constexpr double kBetween = 10.0;

// Of the radius, from one step to the next, at which no length is passed over: at a border it falls
// to a hundredth.
constexpr double kLargestFall = 1e-3;

// Whether a cost function refuses where a step leads, and no share of it gains anything.
bool IsRefused(const IterationSummary& iteration) {
  return !iteration.step_is_successful && iteration.cost >= std::numeric_limits<double>::max();
}

// The same, or it was cut before the border.
bool IsAtBorder(const IterationSummary& iteration) {
  return iteration.step_share < kLargeShare || IsRefused(iteration);
}

}  // namespace

void Stagnation::Begin(double cost) {
  costs_ = {cost};
  gained_from_ = cost;
  num_since_gain_ = 0;
  // What was being proven of another function is over, and so is what its steps have shown.
  widest_ = 0.0;
  went_between_ = false;
  lengths_from_ = cost;
  creeps_ = false;
  is_proving_ = false;
  restart_radius_ = 0.0;
}

double Stagnation::TakeRestartRadius() {
  return std::exchange(restart_radius_, 0.0);
}

// A stall comes first: it may end a proof under way, too.
Stagnation::Verdict Stagnation::After(const IterationSummary& iteration, double cost,
                                      double tolerance, double radius) {
  if (IsStalled(iteration, cost, tolerance, radius)) {
    // Since the last gain steps were tried from little damping on, and all lengths after them; at a
    // border, where every second length is passed over, the others too.
    const bool tried_all = widest_ >= tuning_.proof_radius;
    if (tried_all && (went_between_ || !IsAtBorder(iteration))) {
      return Verdict::kRefusals;
    }
    if (IsAtBorder(iteration) && IsAtLeastRadius(iteration, tolerance) &&
        CreepsAgain(cost, tolerance)) {
      return Verdict::kUnproven;
    }
    // They were not: the descent goes on from there before it may end.
    num_since_gain_ = 0;
    went_between_ = tried_all;
    restart_radius_ = tuning_.proof_radius / (tried_all || creeps_ ? kBetween : 1.0);
  }
  is_damped_hard_ |= radius < tuning_.proof_radius;
  // Refused steps say nothing of what steps gain, and neither do those cut short.
  if (!iteration.step_is_successful || iteration.step_share < kLargeShare) {
    return Verdict::kGoOn;
  }
  costs_.push_back(cost);
  if (is_proving_) {
    return EndProof(iteration, tolerance);
  }
  BeginProof(iteration, tolerance);
  return Verdict::kGoOn;
}

std::string Stagnation::InWords(Verdict verdict, double cost) const {
  if (verdict == Verdict::kRefusals) {
    return Formatted(
        "Steps of all lengths are refused, or gain nothing: %d iterations, from a damping of %e "
        "up, "
        "have gained %e of the cost.",
        num_since_gain_, 1.0 / widest_, (gained_from_ - cost) / cost);
  }
  if (verdict == Verdict::kUnproven && creeps_) {
    return kCreeps;
  }
  const std::string gained =
      Formatted("Steps stagnate: the last %d have gained %e of the cost",
                static_cast<int>(costs_.size()) - 1, (costs_.front() - cost) / cost);
  return gained + (verdict == Verdict::kProven
                       ? ", all of them damped by little."
                       : ", and only with much damping: it is not proven that this is a minimum.");
}

// Asked where a descent through all lengths of steps has ended.
bool Stagnation::CreepsAgain(double cost, double tolerance) {
  const bool crept = std::exchange(
      creeps_, std::exchange(lengths_from_, cost) - cost <= tuning_.stagnation_gain * tolerance);
  return crept && creeps_;
}

bool Stagnation::IsStalled(const IterationSummary& iteration, double cost, double tolerance,
                           double radius) {
  ++num_since_gain_;
  NoteRadius(radius);
  // A gain forgets it: what was tried before it was tried elsewhere.
  if (gained_from_ - cost > tuning_.stall_gain * tolerance) {
    num_since_gain_ = 0;
    gained_from_ = cost;
    widest_ = 0.0;
    went_between_ = false;
  }
  return num_since_gain_ >= tuning_.stall || IsAtLeastRadius(iteration, tolerance);
}

// The widest radius since the last gain, from which on no length was passed over. Steps that are
// hardly damped for once are none of those.
void Stagnation::NoteRadius(double radius) {
  if (radius >= tuning_.seeing_radius && 0.0 < last_radius_ &&
      last_radius_ < kLargestFall * radius) {
    return;
  }
  widest_ = radius < kLargestFall * last_radius_ ? radius : std::max(widest_, radius);
  last_radius_ = radius;
}

// Whether more damping leads nowhere.
bool Stagnation::IsAtLeastRadius(const IterationSummary& iteration, double tolerance) const {
  // At a border, steps are cut or their end cannot be evaluated; damping turns them only, and
  // shorter steps than these have been tried by the cut. The more damping, the less they promise.
  return iteration.trust_region_radius <=
             (IsAtBorder(iteration) ? tuning_.border_radius : tuning_.min_radius) ||
         (IsRefused(iteration) && iteration.model_cost_change <= tuning_.no_gain_share * tolerance);
}

double Stagnation::GainOf(const IterationSummary& iteration) const {
  // Hardly damped, a whole step goes down a flat valley as far as the model wants: more is taken as
  // nothing there.
  const bool is_free =
      iteration.trust_region_radius >= tuning_.free_radius && iteration.step_share >= 1.0;
  return is_free ? tuning_.free_stagnation_gain : tuning_.stagnation_gain;
}

// Whether the last so many steps have brought no more than so many tolerances together. Gains that
// grow, as where a valley begins to fall or a saddle is left, tell of more: nothing is taken as
// nothing there.
bool Stagnation::Brought(int num_steps, double tolerances, const IterationSummary& last,
                         double tolerance) const {
  const auto n = static_cast<std::size_t>(num_steps);
  if (costs_.size() <= n) {
    return false;
  }
  // The sum, and the last gain times their number.
  const double brought = costs_[costs_.size() - 1 - n] - costs_.back();
  const double to_come = num_steps * last.cost_change;
  return to_come <= brought ? brought <= tolerances * tolerance
                            : to_come <= std::min(tolerances, tuning_.stagnation_gain) * tolerance;
}

void Stagnation::BeginProof(const IterationSummary& iteration, double tolerance) {
  // Few steps with hardly any gain are as good as many with a small one.
  is_proving_ =
      Brought(tuning_.stagnation, GainOf(iteration), iteration, tolerance) ||
      Brought(tuning_.quick_stagnation, tuning_.quick_stagnation_gain, iteration, tolerance);
  if (is_proving_) {
    restart_radius_ = tuning_.proof_radius;
    is_damped_hard_ = false;
    // What the proof brings is measured from here.
    costs_ = {costs_.back()};
  } else if (static_cast<int>(costs_.size()) > tuning_.stagnation) {
    // Never more than the longest list that is asked for.
    costs_.pop_front();
  }
}

// A proof that fails is over: what it has gained counts as any steps do.
Stagnation::Verdict Stagnation::EndProof(const IterationSummary& iteration, double tolerance) {
  // What is no proof anyway takes no more steps than it needs to fail.
  const int num_steps = is_damped_hard_ ? tuning_.quick_proof_steps : tuning_.proof_steps;
  const bool ends =
      Brought(num_steps, GainOf(iteration), iteration, tolerance) ||
      Brought(tuning_.quick_proof_steps, tuning_.quick_proof_gain, iteration, tolerance);
  // Until all its steps are taken.
  is_proving_ = ends || static_cast<int>(costs_.size()) <= tuning_.proof_steps;
  return !ends ? Verdict::kGoOn : is_damped_hard_ ? Verdict::kUnproven : Verdict::kProven;
}

}  // namespace inceres::internal
