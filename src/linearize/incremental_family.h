#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/executor.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/linearization.h"
#include "linearize/variable_store.h"
#include "linearize/weighed_residuals.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// The Jacobians of factors whose weight has become zero, as they are without it: where the weight
/// comes back, nothing needs to be linearized to have them. By factor and slot, in the layout of
/// the slots. Cost: what is parked. Threads: one at a time.
class ParkedJacobians {
 public:
  bool Has(int factor) const { return parked_.count(factor) != 0; }

  /// Takes a copy of the factor's rows, whatever was there before.
  void Park(int factor, const SlotJacobians* slots, int num_slots) {
    std::vector<double>& rows = parked_[factor];
    rows.clear();
    for (int s = 0; s < num_slots; ++s) {
      const double* J = slots[s].data + factor * slots[s].factor_stride;
      rows.insert(rows.end(), J, J + slots[s].factor_stride);
    }
  }

  /// Gives the rows back and forgets them. Requires Has.
  void Fetch(int factor, const SlotJacobians* slots, int num_slots) {
    const auto found = parked_.find(factor);
    const double* row = found->second.data();
    for (int s = 0; s < num_slots; ++s) {
      double* J = slots[s].data + factor * slots[s].factor_stride;
      std::copy_n(row, slots[s].factor_stride, J);
      row += slots[s].factor_stride;
    }
    parked_.erase(found);
  }

  /// What was parked is outdated.
  void Drop(int factor) {
    if (!parked_.empty()) {
      parked_.erase(factor);
    }
  }

  std::int64_t Bytes() const {
    std::size_t bytes = 0;
    for (const auto& [factor, rows] : parked_) {
      bytes += sizeof(std::pair<int, std::vector<double>>) + rows.capacity() * sizeof(double);
    }
    return static_cast<std::int64_t>(bytes);
  }

 private:
  std::unordered_map<int, std::vector<double>> parked_;
};

/// What the incremental solver remembers of one family's factors (docs/algorithms.md,
/// "Linearization"), by their places. Arrays grow with the family; the place of a removed factor
/// serves a later one.
///
/// Each factor keeps the Jacobian J of its last linearization, multiplied by √w (I − α n nᵀ) with w
/// = ρ' and n = f/‖f‖ at that time, its residuals now and at the candidate, and what its loss makes
/// of them (WeighedResiduals).
///
/// Lists of factors are ascending, without repeats. Evaluation runs on the executor's threads, each
/// factor writing its own place; everything else on the calling one.
class IncrementalFamily {
 public:
  IncrementalFamily(const FactorGraph& graph, FamilyId id);

  FamilyId id() const { return factors_.id; }
  const FactorFamily& family() const { return *factors_.family; }
  /// Places, free ones among them.
  int num_places() const { return factors_.num_factors; }
  bool constant_jacobian() const { return weighed_.constant_jacobian(); }
  int residual_size() const { return factors_.residual_size; }
  int num_slots() const { return factors_.num_slots; }
  const VariableId* variables(int factor) const { return factors_.graph->Variables(id(), factor); }
  /// Where its variables are, one pointer a slot, and where a step would take them.
  const double* const* parameters(int factor) const { return factors_.Parameters(factor); }
  /// Where Linearize has evaluated it last: where it failed, if it did.
  const double* const* linearized_parameters(int factor) const {
    return factors_.LinearizedParameters(factor);
  }
  const double* const* candidate_parameters(int factor) const {
    return factors_.CandidateParameters(factor);
  }

  /// Takes over the factor at a place, new or used again, or whose variables have got other tangent
  /// maps. Not linearized yet.
  void Connect(int factor, VariableStore* variables);
  /// Whether the factor has a Jacobian for the slot's variable: not for one that is outside the
  /// system, and not for one that is held and has another tangent than the slot.
  bool HasJacobian(int factor, int slot) const {
    return factors_.tangent_offsets[static_cast<std::size_t>(factors_.Entry(factor)) + slot] >= 0;
  }
  /// The factor at this place is gone, or does not count until it is linearized.
  void Forget(int factor) {
    weighed_.Forget(factor);
    parked_.Drop(factor);
  }
  void Unsettle(int factor) { weighed_.Unsettle(factor); }
  void UnsettleAll() { weighed_.UnsettleAll(); }

  /// Lets the factor move its expansion point to the current values; true if it did and wants to be
  /// linearized anew.
  bool Recenter(int factor) const { return family().Recenter(factor, parameters(factor)); }

  /// Evaluates at the candidate, cost only.
  EvaluationFailure EvaluateCandidate(const std::vector<std::int32_t>& factors,
                                      const Executor& executor);
  /// Linearizes at the current values: f, f̂ = f, J (of pinned variables: where they are pinned),
  /// w, q and the cost.
  EvaluationFailure Linearize(const std::vector<std::int32_t>& factors, const Executor& executor);

  /// Whether what is cached can take another weight: there is a Jacobian, and its own weight was
  /// not zero, or has become so by Reweigh.
  bool CanReweigh(int factor) const {
    return weighed_.linearized(factor) &&
           (weighed_.inverse_sqrt_w(factor) > 0.0 || parked_.Has(factor));
  }
  /// The factor has another loss and is the same function otherwise: J, q, the cost and the errors
  /// of the old linearization as that loss weighs them. Evaluates the loss alone. Requires
  /// CanReweigh. False, and nothing has changed, if the loss gives no weight that is finite and not
  /// negative, or no finite cost.
  bool Reweigh(int factor);

  /// What the losses make of its residuals.
  const WeighedResiduals& weighed() const { return weighed_; }
  /// What the cached linearizations predict for a padded step: −Σ (Jδ)ᵀ(q + Jδ/2). Jδ is kept for
  /// Accept.
  double PredictDecrease(const std::vector<std::int32_t>& factors, const double* padded_step);
  /// padded_rhs −= Σ Jᵀq of the listed factors.
  void SubtractGradient(const std::vector<std::int32_t>& factors, double* padded_rhs) const;
  /// PredictDecrease of a step whose candidate was evaluated, with what accepting it does to the
  /// gradient, in one pass over the Jacobians: padded_rhs −= Σ Jᵀ(q_candidate − q).
  double TryStep(const std::vector<std::int32_t>& factors, const double* padded_step,
                 double* padded_rhs);
  /// The step tried last was accepted (WeighedResiduals::Accept).
  double Accept(const std::vector<std::int32_t>& factors) {
    return weighed_.Accept(factors, &factors_);
  }
  /// f now.
  const double* residual(int factor) const {
    return factors_.residuals.data() + std::ptrdiff_t{factor} * residual_size();
  }

  /// Whether the factor's loss has ρ'' > 0 at its present residual, a term that H leaves out.
  bool HasCurvedLoss(int factor) const;
  const Loss* loss(int factor) const { return factors_.graph->loss(id(), factor); }

  const SlotJacobians* slots() const { return factors_.slots.data(); }
  std::int32_t* y_targets() { return y_targets_.data(); }
  const double* Jacobian(int factor, int slot) const {
    return slots()[slot].data + factor * slots()[slot].factor_stride;
  }

  std::int64_t Bytes() const;

 private:
  void ScaleJacobian(int factor, double scale);
  double TakeBackWeight(int factor);
  void Grow(int num_places);
  bool Weigh(int factor);

  Linearization factors_;
  const Kernels* kernels_;
  WeighedResiduals weighed_;
  std::vector<std::int32_t> y_targets_;  // per factor and slot
  ParkedJacobians parked_;               // of factors that Reweigh has left without weight
};

}  // namespace inceres::internal
