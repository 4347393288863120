#include "incremental/stagnation.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

namespace inceres::internal {
namespace {

// A step of which less than this was taken tells of a border, not of what is left to gain.
constexpr double kLargeShare = 0.25;

}  // namespace

void Stagnation::Begin(double cost) {
  costs_ = {cost};
  gained_from_ = cost;
  num_since_gain_ = 0;
}

double Stagnation::TakeRestartRadius() {
  return std::exchange(restart_radius_, 0.0);
}

Stagnation::Verdict Stagnation::After(const IterationSummary& iteration, double cost,
                                      double tolerance, double radius) {
  if (IsStalled(iteration, cost, tolerance, radius)) {
    if (widest_ >= tuning_.proof_radius) {
      return Verdict::kRefusals;
    }
    num_since_gain_ = 0;
    restart_radius_ = tuning_.proof_radius;
  }
  if (!iteration.step_is_successful || iteration.step_share < kLargeShare) {
    return Verdict::kGoOn;
  }
  costs_.push_back(cost);
  if (is_proving_) {
    return EndsProof(iteration, tolerance) ? Verdict::kProven : Verdict::kGoOn;
  }
  BeginProof(iteration, tolerance);
  return Verdict::kGoOn;
}

bool Stagnation::IsStalled(const IterationSummary& iteration, double cost, double tolerance,
                           double radius) {
  ++num_since_gain_;
  widest_ = std::max(widest_, radius);
  if (gained_from_ - cost > tuning_.stall_gain * tolerance) {
    num_since_gain_ = 0;
    gained_from_ = cost;
    widest_ = 0.0;
  }
  return num_since_gain_ >= tuning_.stall || IsAtLeastRadius(iteration);
}

// Whether more damping leads nowhere.
bool Stagnation::IsAtLeastRadius(const IterationSummary& iteration) const {
  const bool at_border =
      iteration.step_share < kLargeShare ||
      (!iteration.step_is_successful && iteration.cost >= std::numeric_limits<double>::max());
  return iteration.trust_region_radius <= (at_border ? tuning_.border_radius : tuning_.min_radius);
}

double Stagnation::GainOf(const IterationSummary& iteration) const {
  return iteration.trust_region_radius >= tuning_.free_radius ? tuning_.free_stagnation_gain
                                                              : tuning_.stagnation_gain;
}

// Whether the last so many steps have brought no more than so many tolerances together. Gains that
// grow, as where a valley begins to fall, are no end.
bool Stagnation::Brought(int num_steps, double tolerances, const IterationSummary& last,
                         double tolerance) const {
  const auto n = static_cast<std::size_t>(num_steps);
  return costs_.size() > n && std::max(costs_[costs_.size() - 1 - n] - costs_.back(),
                                       num_steps * last.cost_change) <= tolerances * tolerance;
}

void Stagnation::BeginProof(const IterationSummary& iteration, double tolerance) {
  is_proving_ =
      Brought(tuning_.stagnation, GainOf(iteration), iteration, tolerance) ||
      Brought(tuning_.quick_stagnation, tuning_.quick_stagnation_gain, iteration, tolerance);
  if (is_proving_) {
    restart_radius_ = tuning_.proof_radius;
    costs_ = {costs_.back()};
  } else if (static_cast<int>(costs_.size()) > tuning_.stagnation) {
    costs_.pop_front();
  }
}

// A proof that fails is over: what it has gained counts as any steps do.
bool Stagnation::EndsProof(const IterationSummary& iteration, double tolerance) {
  const bool proven =
      Brought(tuning_.proof_steps, GainOf(iteration), iteration, tolerance) ||
      Brought(tuning_.quick_proof_steps, tuning_.quick_proof_gain, iteration, tolerance);
  is_proving_ = proven || static_cast<int>(costs_.size()) <= tuning_.proof_steps;
  return proven;
}

}  // namespace inceres::internal
