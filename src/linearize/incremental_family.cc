#include "linearize/incremental_family.h"

#include <algorithm>
#include <cmath>

#include "linearize/robustify.h"
#include "problem/slot_space.h"

namespace inceres::internal {

// The cached linearizations of one family in incremental mode. A step goes through
// EvaluateCandidate (f, cost, w' and q at the candidate), TryStep (J δ is kept) and Accept (the
// candidate becomes the present). A step that is refused leaves only values of the candidate
// behind, which the next one overwrites.
//
// J is kept with the weight and the correction that its loss had when it was linearized, and q is
// the residual for which Jᵀq is the exact robust gradient with that J (docs/algorithms.md,
// "Linearization"): q is renewed at every point, J only where the linearization has become wrong.
// Both lie by place, so that lists of factors need no other table.

namespace {

// What a factor is told of a variable that it has no Jacobian for.
constexpr TangentMap kConstantMap{TangentMap::Kind::kConstant};

}  // namespace

IncrementalFamily::IncrementalFamily(const FactorGraph& graph, FamilyId id)
    : factors_(graph, id), kernels_(&BestKernels()), weighed_(*factors_.family) {
}

// Capacity doubles, so that a factor costs constant time on average; all arrays by place grow
// together.
void IncrementalFamily::Grow(int num_places) {
  const int capacity = num_places > factors_.capacity
                           ? 2 * num_places
                           : factors_.capacity;  // the columns grow in step
  factors_.Grow(num_places, capacity);
  factors_.candidate_parameters.resize(factors_.parameters.size(), nullptr);
  weighed_.Grow(num_places, capacity);
  y_targets_.resize(factors_.parameters.size(), -1);
}

// A place that is used again begins like a new one: no linearization, no steadiness, no blocks of
// Y. Pointers into the variable store are looked up here, once. A variable that was free and is
// held has a map and a place in padded vectors, which are of its own tangent: a factor that came
// since may have another one at the slot, for of a constant nobody asks. It cannot be set free
// while that factor is there.
void IncrementalFamily::Connect(int factor, VariableStore* variable_store) {
  if (factor >= num_places()) {
    Grow(factor + 1);
  }
  Forget(factor);
  Unsettle(factor);
  const FactorGraph& graph = *factors_.graph;
  for (int s = 0; s < num_slots(); ++s) {
    const VariableId id = variables(factor)[s];
    const bool fits = variable_store->quad(id) < 0 || !graph.IsConstant(id) ||
                      CouldMoveInSlot(graph, id, family(), s);
    const TangentMap& map = fits ? variable_store->map(id) : kConstantMap;
    const auto at = static_cast<std::size_t>(factors_.Entry(factor)) + s;
    // A variable that is constant is not linearized and needs no pin.
    factors_.Connect(at, variable_store->current(id),
                     graph.HasPins() && map.wanted() ? graph.PinnedValues(id) : nullptr, map);
    factors_.candidate_parameters[at] = variable_store->candidate(id);
    factors_.tangent_offsets[at] = fits ? variable_store->quad(id) : -1;
    y_targets_[at] = -1;
  }
}

// On a failure some candidates are weighed and others are not; the caller gives the step up, and
// they are never read.
EvaluationFailure IncrementalFamily::EvaluateCandidate(const std::vector<std::int32_t>& factors,
                                                       const Executor& executor) {
  const EvaluationFailure unprepared = factors_.Prepare(/*jacobians=*/false, factors);
  if (unprepared.failed()) {
    return unprepared;
  }
  // Weights are taken run by run, while the residuals are in the cache.
  return factors_.ForRuns(factors, executor, [this](int begin, int end) {
    const EvaluationFailure failure = factors_.EvaluateCandidate(begin, end);
    if (!failure.failed()) {
      weighed_.WeighCandidates(factors_, begin, end);
    }
    return failure;
  });
}

// A factor whose weight was zero and is linearized anew has a J of now, so what was parked of it is
// out of date.
EvaluationFailure IncrementalFamily::Linearize(const std::vector<std::int32_t>& factors,
                                               const Executor& executor) {
  const EvaluationFailure unprepared = factors_.Prepare(/*jacobians=*/true, factors);
  if (unprepared.failed()) {
    return unprepared;
  }
  // Before the threads start: the parked Jacobians are one table for all factors.
  for (const std::int32_t factor : factors) {
    parked_.Drop(factor);
  }
  return factors_.ForRuns(factors, executor, [this](int begin, int end) {
    const EvaluationFailure failure = factors_.Linearize(begin, end);
    for (int i = begin; i < end && !failure.failed(); ++i) {
      if (!Weigh(i)) {
        return EvaluationFailure{i, kLossWithoutWeight};
      }
    }
    return failure;
  });
}

// √w (I − α n nᵀ) J, unless that is J itself, as without a loss or within Huber's bend. f stays as
// it was evaluated, for q and costs are made of it. False if there is no such J: in S it would stay
// for good, since what is not finite cannot be taken out of a sum.
bool IncrementalFamily::Weigh(int factor) {
  const RobustScale scale = weighed_.Weigh(factors_, factor);
  if (!scale.is_finite()) {
    return false;
  }
  if (!scale.is_one()) {
    scale.Apply(residual(factor), residual_size(), num_slots(), slots(), factor,
                factors_.tangent_offsets.data() + factors_.Entry(factor));
  }
  return true;
}

// Jδ of each factor stays by its place: Accept moves f̂ by it, f̂ := f̂ + Jδ.
double IncrementalFamily::PredictDecrease(const std::vector<std::int32_t>& factors,
                                          const double* padded_step) {
  kernels_->multiply_rows(factors_.Rows(0, 0), factors.data(), static_cast<int>(factors.size()),
                          padded_step, weighed_.step_products());
  return weighed_.PredictedDecrease(factors);
}

void IncrementalFamily::SubtractGradient(const std::vector<std::int32_t>& factors,
                                         double* padded_rhs) const {
  kernels_->subtract_transposed(factors_.Rows(0, 0), factors.data(),
                                static_cast<int>(factors.size()), weighed_.q(), padded_rhs);
}

// Evaluates the loss: only factors that are asked for this pay for it.
bool IncrementalFamily::HasCurvedLoss(int factor) const {
  return LossValue(factors_.graph->loss(id(), factor), residual(factor), residual_size()).rho[2] >
         0.0;
}

// One pass over the Jacobians for both products. If the step is refused, padded_rhs is the caller's
// to throw away. What is subtracted is Σ Jᵀ(q_candidate − q), the change of η with the sign that b
// has; J stays, so that difference is all that a step does to the gradient.
double IncrementalFamily::TryStep(const std::vector<std::int32_t>& factors,
                                  const double* padded_step, double* padded_rhs) {
  FactorRows rows = factors_.Rows(0, 0);
  rows.residuals = weighed_.q();
  return kernels_->try_rows(rows, factors.data(), static_cast<int>(factors.size()), padded_step,
                            weighed_.candidate_q(), weighed_.step_products(), padded_rhs);
}

// Another loss for a factor that is the same function otherwise: what is cached takes the new
// weight, and nothing is evaluated.
//
// See docs/algorithms.md, "Incremental Schur complement" (other weights). The cached J is
// √w (I − α n nᵀ) J_plain, so the plain one comes back by the inverses, I + β n nᵀ and 1/√w, and
// takes √w' of the new loss: J := √w' J_plain. What is lost is rounding. f and f̂ do not depend on
// the loss; cost, w, q and the errors follow from them.
//
// 1/√w does not exist where w is zero. Such a Jacobian is parked without its weight, and fetched
// when a weight comes back; a factor that was linearized with weight zero was never parked, and
// CanReweigh says no. So a loss may turn a factor off and on without its being evaluated.

// All of a block, padding included. Slots without a tangent, of constant variables, have nothing to
// scale.
void IncrementalFamily::ScaleJacobian(int factor, double scale) {
  for (int s = 0; s < num_slots(); ++s) {
    if (!HasJacobian(factor, s)) {
      continue;
    }
    const SlotJacobians& slot = slots()[s];
    double* J = slot.data + factor * slot.factor_stride;
    std::for_each(J, J + slot.factor_stride, [scale](double& entry) { entry *= scale; });
  }
}

// Brings back the plain J, up to a factor that is returned: of w and α at the linearization, or of
// what was parked.
double IncrementalFamily::TakeBackWeight(int factor) {
  // What stands in the slots then is next to zero and is overwritten.
  if (weighed_.inverse_sqrt_w(factor) == 0.0) {
    parked_.Fetch(factor, slots(), num_slots());
    return 1.0;
  }
  // The rank-one part first; the scalar part is left to the caller, who has another one to apply,
  // in one pass.
  for (int s = 0; s < num_slots() && weighed_.IsCorrected(factor); ++s) {
    if (HasJacobian(factor, s)) {
      TakeBackCorrection(weighed_.correction(factor), residual_size(), slots()[s],
                         slots()[s].data + factor * slots()[s].factor_stride);
    }
  }
  return weighed_.inverse_sqrt_w(factor);
}

// J := √w J_plain.
bool IncrementalFamily::Reweigh(int factor) {
  const double* f = residual(factor);
  const LossValue value(loss(factor), f, residual_size());
  // Nothing has been written so far.
  if (!value.HasWeight() || !std::isfinite(value.cost())) {
    return false;
  }
  const double sqrt_w = std::sqrt(value.weight());
  double scale = TakeBackWeight(factor);
  // Parked first, as it is without any weight; then the slots become next to zero, so that the
  // factor drops out of H and η.
  if (WeighedResiduals::IsNoWeight(sqrt_w)) {
    ScaleJacobian(factor, scale);
    scale = 1.0;
    parked_.Park(factor, slots(), num_slots());
  }
  ScaleJacobian(factor, scale * sqrt_w);
  weighed_.Reweigh(factor, value, f);
  return true;
}

// Per entry there are three pointers and two offsets.
std::int64_t IncrementalFamily::Bytes() const {
  const std::size_t doubles = factors_.residuals.size() + factors_.candidate_residuals.size() +
                              factors_.jacobian_values.size();
  return static_cast<std::int64_t>(doubles * sizeof(double) + weighed_.Bytes() + parked_.Bytes() +
                                   factors_.parameters.capacity() *
                                       (3 * sizeof(void*) + 2 * sizeof(std::int32_t)));
}

}  // namespace inceres::internal
