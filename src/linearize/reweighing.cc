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

#include <algorithm>
#include <cmath>

#include "linearize/incremental_family.h"
#include "linearize/robustify.h"

namespace inceres::internal {

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

}  // namespace inceres::internal
