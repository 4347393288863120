#include "incremental/cached_rows.h"

#include <algorithm>
#include <cmath>

#include "linearize/robustify.h"

namespace inceres::internal {

// Rows of the least-squares problem for marginalization (docs/algorithms.md, "Linearization" and
// "Marginalization"), from what incremental mode has cached instead of an evaluation. Kept is √w (I
// − α n nᵀ) J with the weight w and α of the linearization; wanted is √ρ' J and √ρ' f with the
// weight ρ' of now and no second-order term, as a batch linearization of a loss with ρ'' ≤ 0 has
// it. So J is scaled by √(ρ'/w), and the correction, of rank one, is undone. The residual is the
// current one and exact; only the age of J is an error, which the caller bounds by `limit`.
//
// Buffers are used again from call to call: a result is valid until the next one.

// The error is compared so that a NaN is not good.
bool CachedRows::IsGood(const IncrementalFamily& family, FactorRef ref) const {
  if (ref.factor >= family.num_places() || !family.weighed().linearized(ref.factor) ||
      system_.IsDirty(ref) || !(family.weighed().SquaredError(ref.factor) <= limit_)) {
    return false;
  }
  // Zero: no weight now. Infinite or NaN: next to none at the linearization, of which nothing can
  // be restored.
  const double ratio = family.weighed().WeightRatio(ref.factor);
  return ratio > 0.0 && std::isfinite(ratio) && !family.HasCurvedLoss(ref.factor);
}

// A copy, scaled and without the correction: the cached one stays part of S.
void CachedRows::CopyJacobian(const IncrementalFamily& family, int factor, int slot, double scale) {
  const SlotJacobians& cached = family.slots()[slot];
  const double* J = family.Jacobian(factor, slot);
  std::vector<double>& copy = jacobians_[slot];
  copy.assign(J, J + cached.factor_stride);
  for (double& entry : copy) {
    entry *= scale;
  }
  if (family.weighed().IsCorrected(factor)) {
    // (I + β n nᵀ) times the kept one is the plain one: scalars commute with it, so the order is
    // free.
    TakeBackCorrection(family.weighed().correction(factor), family.residual_size(), cached,
                       copy.data());
  }
  slots_[slot].data = copy.data();
}

bool CachedRows::Find(FactorId id, const std::function<bool(VariableId)>& wanted,
                      LinearizedFactor* result) {
  const FactorRef ref{id.family, id.index};
  if (id.family >= static_cast<FamilyId>(system_.families().size()) ||
      !IsGood(system_.families()[id.family], ref)) {
    return false;
  }
  const IncrementalFamily& family = system_.families()[id.family];
  const IncrementalSchur& schur = system_.schur();
  const std::int32_t landmark = schur.structure().LandmarkOfFactor(ref);
  // Cached is √w_then J, corrected or not (IncrementalFamily); the factor's share of the
  // least-squares problem now is √ρ' J and √ρ' f.
  const double scale = std::sqrt(family.weighed().WeightRatio(id.index));
  slots_.resize(family.num_slots());
  jacobians_.resize(std::max(jacobians_.size(), slots_.size()));
  // Slots that nobody wants keep their layout and have no data.
  for (int s = 0; s < family.num_slots(); ++s) {
    const VariableId variable = family.variables(id.index)[s];
    const SlotJacobians& cached = family.slots()[s];
    slots_[s] = {nullptr, cached.factor_stride, cached.row_stride, cached.columns};
    if (!wanted(variable)) {
      continue;
    }
    // A variable that was constant when the factor was linearized has no Jacobian in the cache.
    if (schur.structure().FrameOfFactor(ref, s) < 0 &&
        (landmark < 0 || schur.landmarks()[landmark].id != variable)) {
      return false;
    }
    CopyJacobian(family, id.index, s, scale);
  }
  f_.assign(family.residual(id.index), family.residual(id.index) + family.residual_size());
  for (double& entry : f_) {
    // √ρ' f, not the q of the family: q has the correction of the old linearization in it.
    entry *= std::sqrt(family.weighed().weight(id.index));
  }
  *result = {family.residual_size(), f_.data(), slots_.data()};
  return true;
}

}  // namespace inceres::internal
