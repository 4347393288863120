#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "block/kernels.h"
#include "inceres/graph/factor_graph.h"
#include "linearisation/live_tangents.h"
#include "linearisation/live_values.h"

namespace inceres::internal {

/// What the incremental solver remembers of one family's factors (algorithms.md section 2). Arrays grow with the family.
///
/// Each factor keeps the Jacobian J of its last linearisation, multiplied by √w with w = ρ' at that time; the residual f now; the
/// residual f̂ that the old linearisation predicts now; and q = ρ' f / √w, so that its gradient share is Jᵀq. ‖f − f̂‖ is the error
/// of the old linearisation, known for nothing. The second-order term of losses with ρ'' > 0 is left out of H.
class LiveFamily {
 public:
  LiveFamily(const FactorGraph& graph, FamilyId id);

  FamilyId id() const { return id_; }
  const FactorFamily& family() const { return *family_; }
  int num_factors() const { return num_factors_; }
  int residual_size() const { return residual_size_; }
  int num_slots() const { return num_slots_; }
  const VariableId* variables(int factor) const { return graph_->Variables(id_, factor); }

  /// Takes over the factors the graph has gained.
  void Grow(LiveValues* values, const LiveTangents& tangents);

  /// Evaluates at the candidate, cost only; *cost gets Σ ½ρ of the listed factors. `factors` ascending, no repeats.
  EvaluationFailure EvaluateCandidate(const std::vector<std::int32_t>& factors);
  /// Linearises at the current values: f, f̂ = f, J, w, q and the cost.
  EvaluationFailure Linearise(const std::vector<std::int32_t>& factors);

  /// ½ρ at the candidate / now.
  double CandidateCost(int factor) const { return candidate_cost_[factor]; }
  double Cost(int factor) const { return cost_[factor]; }

  /// What the cached linearisation predicts for a padded step: −(Jδ)ᵀ(q + Jδ/2). Jδ is kept for Accept.
  double PredictDecrease(int factor, const double* padded_step);
  /// The step was accepted: f := candidate f, f̂ += J δ / √w. Replaces q and writes the change to *q_change.
  void Accept(int factor, double* q_change);
  const double* q(int factor) const { return q_.data() + static_cast<std::ptrdiff_t>(factor) * residual_size_; }

  /// w ‖f − f̂‖²: the squared error of the old linearisation in units of the objective.
  double SquaredError(int factor) const;
  /// ρ' now over ρ' at the linearisation.
  double WeightRatio(int factor) const;

  const SlotJacobians* slots() const { return slots_.data(); }
  const double* q_data() const { return q_.data(); }
  std::int32_t* y_targets() { return y_targets_.data(); }
  const double* Jacobian(int factor, int slot) const { return slots_[slot].data + factor * slots_[slot].factor_stride; }

 private:
  template <typename Evaluate>
  EvaluationFailure ForRuns(const std::vector<std::int32_t>& factors, Evaluate&& evaluate);
  void Weigh(int factor);
  void EvaluateLoss(int factor, double rho[3]) const;

  const FactorGraph* graph_;
  const FactorFamily* family_;
  FamilyId id_;
  int residual_size_;
  int num_slots_;
  int num_factors_ = 0;
  std::vector<AlignedVector<double>> jacobians_;  // per slot
  std::vector<SlotJacobians> slots_;
  std::vector<JacobianView> views_;
  std::vector<double> f_;
  std::vector<double> candidate_f_;
  std::vector<double> predicted_f_;
  std::vector<double> J_step_;  // J δ of the step under construction
  std::vector<double> q_;
  std::vector<double> sqrt_w_;
  std::vector<double> current_w_;
  std::vector<double> cost_;
  std::vector<double> candidate_cost_;
  std::vector<const double*> parameters_;
  std::vector<const double*> candidate_parameters_;
  std::vector<const TangentMap*> maps_;
  std::vector<std::int32_t> step_quads_;  // per factor and slot: where the variable's step stands, or -1
  std::vector<std::int32_t> y_targets_;
};

}  // namespace inceres::internal
