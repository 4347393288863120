#include "incremental/relinearization.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace inceres::internal {

// When an old Jacobian is renewed (docs/algorithms.md, "Relinearization"). The error of an old
// linearization is known for nothing, e = ‖f − f̂‖, and is held against shares of the tolerance T:
//
//     w e² > θ_r · 2T / m      or      (w ‖f‖ e)² > (κ θ_r T)² / m,      m factors.
//
// Three times: after a step, of the factors it touched; before success, of those that have aged;
// and before a retreat, of those that the refused step rests on. To find the second without a pass
// over all factors, a step also remembers those that err by more than a quarter of what success
// would allow. all_are_in_ are the limits for which that memory is complete: it is complete for all
// larger ones, and where T has fallen below them every factor is looked at.

namespace {

// Of the tolerance: factors that would be too old with so little of it are followed, so that all of
// them need to be looked at only when the cost has fallen by more.
constexpr double kAhead = 0.25;

}  // namespace

// The memory of aged factors stays: it is of the factors, not of the Update.
void Relinearization::Begin(const IncrementalOptions& options, double share) {
  share_ = share;
  rule_ = options.relinearization;
  step_ = options.relinearization_step;
  blamed_few_ = false;
}

// How far an old linearization may err before it is renewed, if every factor erred by as much. Its
// error e = ‖f − f̂‖ counts twice: the model is off by w e², and the gradient by what the residual
// f makes of the old Jacobian, about w ‖f‖ e over the next step. The first adds up over the
// factors, the second, of either sign, like a random walk.
Relinearization::ErrorLimits Relinearization::LimitsOf(double share, double tolerance) const {
  const double count = std::max(1, system_.num_factors());
  const double gradient = tuning_.gradient_share * share * tolerance;
  return {share * 2.0 * tolerance / count, gradient * gradient / count};
}

void Relinearization::MakeRoom() {
  aged_.resize(system_.families().size());
  for (const IncrementalFamily& family : system_.families()) {
    aged_[family.id()].Grow(family.num_places());
  }
}

// The limits of what is remembered. With a larger T that is less: from here on the memory is
// complete for those limits only.
Relinearization::ErrorLimits Relinearization::BeginLooking(double tolerance) {
  const ErrorLimits aged = AgedLimits(kAhead * tolerance);
  all_are_in_.RaiseTo(aged);
  MakeRoom();
  return aged;
}

void Relinearization::Judge(const IncrementalFamily& family, int factor, bool is_stale,
                            const ErrorLimits& aged) {
  if (is_stale) {
    // It will be renewed before the next claim.
    aged_[family.id()].Remove(factor);
    system_.MarkDirty({family.id(), factor});
  } else if (aged.ExceededBy(family, factor)) {
    aged_[family.id()].Add(factor);
    worst_.RaiseTo(ErrorLimits::Of(family, factor));
  }
}

// After the residuals of the step were accepted, and before the step ends: it names the factors.
void Relinearization::MarkStale(double tolerance) {
  const ErrorLimits stale = LimitsOf(share_, tolerance);
  const ErrorLimits aged = BeginLooking(tolerance);
  for (const IncrementalFamily& family : system_.families()) {
    for (const std::int32_t i : system_.step().Touched(family.id())) {
      // Steps do not age a constant Jacobian, however long they are; its error is zero by
      // definition, so that the other rule says what it should.
      const bool errs = rule_ == RelinearizationRule::kStepSize && !family.constant_jacobian()
                            ? system_.step().Largest({family.id(), i}) >= step_
                            : stale.ExceededBy(family, i);
      Judge(family, i,
            errs || family.weighed().WeightIsOff(i, family.weighed().IsCorrected(i)
                                                        ? tuning_.corrected_weight_change
                                                        : tuning_.weight_change),
            aged);
    }
  }
}

// The weight has changed and not the Jacobian, so there is no step to judge: by error, whatever the
// rule.
void Relinearization::LookAt(const std::vector<FactorRef>& factors, double tolerance) {
  const ErrorLimits stale = LimitsOf(share_, tolerance);
  const ErrorLimits aged = BeginLooking(tolerance);
  for (const FactorRef& ref : factors) {
    const IncrementalFamily& family = system_.families()[ref.family];
    Judge(family, ref.factor, stale.ExceededBy(family, ref.factor), aged);
  }
}

// Every factor, into the set of those that may be too old: how old they are is seen there.
void Relinearization::FindAged() {
  MakeRoom();
  for (const IncrementalFamily& family : system_.families()) {
    for (int i = 0; i < family.num_places(); ++i) {
      if (family.weighed().linearized(i)) {
        aged_[family.id()].Add(i);
      }
    }
  }
  worst_ = {HUGE_VAL, HUGE_VAL};
}

// Factors leave the memory when they are marked, when they err by less than a quarter again, or
// when they are gone.
bool Relinearization::RefreshErring(double tolerance) {
  const ErrorLimits limits = AgedLimits(tolerance);
  const ErrorLimits ahead = AgedLimits(kAhead * tolerance);
  // T has fallen by more than kAhead since, or m has risen.
  if (limits.IsBelow(all_are_in_)) {
    FindAged();
    all_are_in_ = ahead;
  }
  all_are_in_.RaiseTo(ahead);
  // Mostly nothing has aged that much, and those that have aged less are not gone through.
  if (!limits.IsBelow(worst_)) {
    return false;
  }
  worst_ = {0.0, 0.0};
  bool any = false;
  for (std::size_t family = 0; family < aged_.size(); ++family) {
    const IncrementalFamily& factors = system_.families()[family];
    IndexSet& aged = aged_[family];
    aged.ForEach([&](std::int32_t i) {
      if (factors.weighed().linearized(i) && limits.ExceededBy(factors, i)) {
        system_.MarkDirty({factors.id(), i});
        any = true;
      } else if (factors.weighed().linearized(i) && ahead.ExceededBy(factors, i)) {
        worst_.RaiseTo(ErrorLimits::Of(factors, i));
        return;
      }
      aged.Remove(i);
    });
  }
  return any;
}

// An error Δg of the gradient hides ½ Δg² / s where H is as stiff as s: of a far point along its
// ray, thousands of times what the limits have in mind.
bool Relinearization::RefreshWeak(double tolerance) {
  const ErrorLimits limits = AgedLimits(tolerance);
  bool any = false;
  weak_.ForEachFactor([&](FactorRef ref) {
    const IncrementalFamily& family = system_.families()[ref.family];
    if (family.weighed().linearized(ref.factor) && limits.ExceededBy(family, ref.factor)) {
      system_.MarkDirty(ref);
      any = true;
    }
  });
  return any;
}

bool Relinearization::RefreshTouched(bool evaluated) {
  // Only what errs by more than rounding is old.
  const auto for_each_old = [this](auto&& visit) {
    for (const IncrementalFamily& family : system_.families()) {
      for (const std::int32_t i : system_.step().Touched(family.id())) {
        if (family.weighed().SquaredError(i) > tuning_.exact) {
          visit(FactorRef{family.id(), i});
        }
      }
    }
  };
  const auto unforeseen = [this](FactorRef ref) {
    return system_.families()[ref.family].weighed().UnforeseenCost(ref.factor);
  };
  // Few are renewed first, for a Jacobian costs more than a residual; if the step after that fails
  // as well, the choice was wrong. A step that was not evaluated blames nobody.
  const bool all = std::exchange(blamed_few_, true) || !evaluated;
  double worst = 0.0;
  if (!all) {
    for_each_old([&](FactorRef factor) { worst = std::max(worst, unforeseen(factor)); });
  }
  // Written so that a cost that is not finite is to blame.
  const double blameless =
      std::min(tuning_.blame_share * worst, std::numeric_limits<double>::max());
  bool any = false;
  for_each_old([&](FactorRef factor) {
    if (all || !(unforeseen(factor) <= blameless)) {
      system_.MarkDirty(factor);
      any = true;
    }
  });
  return any;
}

}  // namespace inceres::internal
