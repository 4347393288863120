#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/linearization.h"
#include "linearize/parked_jacobians.h"
#include "linearize/variable_store.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// What the incremental solver remembers of one family's factors (docs/algorithms.md,
/// "Linearization"), by their places. Arrays grow with the family; the place of a removed factor
/// serves a later one.
///
/// Each factor keeps the Jacobian J of its last linearization, multiplied by √w (I − α n nᵀ) with w
/// = ρ' and n = f/‖f‖ at that time; the residual f now; the residual f̂ that the old linearization
/// predicts now; and q = ρ' (I + β n nᵀ) f / √w, where β = α/(1 − α), so that its gradient share is
/// Jᵀq. ‖f − f̂‖ is the error of the old linearization, known for nothing; it is zero by definition
/// where the family's Jacobian is constant.
///
/// α takes the second-order term of losses with ρ'' < 0, as far as H stays well-conditioned (Triggs
/// et al., "Bundle Adjustment: A Modern Synthesis", 1999, section 4.3): without it each step falls
/// short by what the outliers let it, and the steps converge linearly. It is 0 unless the factor's
/// last step has changed its residual little, for far from the minimum the curvature at a point
/// tells little of a robust loss; and where ρ'' ≥ 0.
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
  bool constant_jacobian() const { return constant_jacobian_; }
  int residual_size() const { return factors_.residual_size; }
  int num_slots() const { return factors_.num_slots; }
  const VariableId* variables(int factor) const { return factors_.graph->Variables(id(), factor); }
  /// Where its variables are, one pointer a slot, and where a step would take them.
  const double* const* parameters(int factor) const { return factors_.Parameters(factor); }
  const double* const* candidate_parameters(int factor) const {
    return factors_.CandidateParameters(factor);
  }

  /// Takes over the factor at a place, new or used again, or whose variables have got other tangent
  /// maps. Not linearized yet.
  void Connect(int factor, VariableStore* variables);
  /// The factor at this place is gone, or does not count until it is linearized.
  void Forget(int factor) {
    linearized_[factor] = Linearized::kNot;
    parked_.Drop(factor);
  }
  /// Its residual is another than its last step has led to: the next linearization takes no
  /// second-order term.
  void Unsettle(int factor) { steady_[factor] = 0; }
  void UnsettleAll() { std::fill(steady_.begin(), steady_.end(), 0); }

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
    return linearized(factor) && (states_[factor].inverse_sqrt_w > 0.0 || parked_.Has(factor));
  }
  /// The factor has another loss and is the same function otherwise: J, q, the cost and the errors
  /// of the old linearization as that loss weighs them. Evaluates the loss alone. Requires
  /// CanReweigh. False, and nothing has changed, if the loss gives no weight that is finite and not
  /// negative, or no finite cost.
  bool Reweigh(int factor);

  /// ½ρ at the candidate / now.
  double CandidateCost(int factor) const { return states_[factor].candidate_cost; }
  double Cost(int factor) const { return states_[factor].cost; }
  /// Σ of the first less the second.
  double CandidateChange(const std::vector<std::int32_t>& factors) const;

  /// What the cached linearizations predict for a padded step: −Σ (Jδ)ᵀ(q + Jδ/2). Jδ is kept for
  /// Accept.
  double PredictDecrease(const std::vector<std::int32_t>& factors, const double* padded_step);
  /// Of one factor, after PredictDecrease: −qᵀJδ and ‖Jδ‖².
  void Slope(int factor, double* slope, double* curvature) const;
  /// Of one factor, after TryStep: by how much its cost rises more, or falls less, than its
  /// linearization predicts.
  double UnforeseenCost(int factor) const;
  /// padded_rhs −= Σ Jᵀq of the listed factors.
  void SubtractGradient(const std::vector<std::int32_t>& factors, double* padded_rhs) const;
  /// PredictDecrease of a step whose candidate was evaluated, with what accepting it does to the
  /// gradient, in one pass over the Jacobians: padded_rhs −= Σ Jᵀ(q_candidate − q).
  double TryStep(const std::vector<std::int32_t>& factors, const double* padded_step,
                 double* padded_rhs);
  /// The step tried last was accepted: f := candidate f, f̂ += (I + β n nᵀ) J δ / √w, q :=
  /// candidate q. Returns the change of the cost.
  double Accept(const std::vector<std::int32_t>& factors);
  const double* q(int factor) const { return q_.data() + First(factor); }
  /// f and ρ' now.
  const double* residual(int factor) const { return factors_.residuals.data() + First(factor); }
  double weight(int factor) const { return states_[factor].w; }

  /// The factor's Jacobian is part of H.
  bool linearized(int factor) const { return linearized_[factor] != Linearized::kNot; }
  /// w ‖f − f̂‖²: the squared error of the old linearization in units of the objective.
  double SquaredError(int factor) const { return states_[factor].error; }
  /// The square of w ‖f‖ ‖f − f̂‖: how far its Jacobian's age may mislead the gradient, over a step
  /// like the ones since.
  double SquaredGradientError(int factor) const { return states_[factor].squared_gradient_error; }
  /// ρ' now over ρ' at the linearization; 0 if there was no weight to speak of.
  double WeightRatio(int factor) const {
    const State& state = states_[factor];
    return state.w * state.inverse_sqrt_w * state.inverse_sqrt_w;
  }
  /// Whether ρ' is now more than `ratio` times ρ' at the linearization, or less than the inverse of
  /// it.
  bool WeightIsOff(int factor, double ratio) const {
    const State& state = states_[factor];
    return state.w > ratio * state.linearized_w || ratio * state.w < state.linearized_w;
  }

  /// Whether the factor's loss has ρ'' > 0 at its present residual, a term that H leaves out.
  bool HasCurvedLoss(int factor) const;
  const Loss* loss(int factor) const { return factors_.graph->loss(id(), factor); }
  /// Whether α ≠ 0: then its Jacobian is not √w times the plain one.
  bool IsCorrected(int factor) const { return linearized_[factor] == Linearized::kCorrected; }
  /// √β n of a factor that is corrected: the plain √w J is (I + β n nᵀ) times the one kept.
  const double* correction(int factor) const { return correction_.data() + First(factor); }

  const SlotJacobians* slots() const { return factors_.slots.data(); }
  const double* q_data() const { return q_.data(); }
  std::int32_t* y_targets() { return y_targets_.data(); }
  const double* Jacobian(int factor, int slot) const {
    return slots()[slot].data + factor * slots()[slot].factor_stride;
  }

  std::int64_t Bytes() const;

 private:
  enum class Linearized : char { kNot, kPlainly, kCorrected };

  // What a factor keeps besides its residuals: one cache line.
  struct alignas(64) State {
    double cost;  // ½ρ and ρ' now
    double w;
    double candidate_cost;  // and at the candidate
    double candidate_w;
    double linearized_w;    // ρ' at the linearization
    double inverse_sqrt_w;  // of the same; 0 if there is no weight to speak of
    double error;
    double squared_gradient_error;
  };

  // Below this √w the linearization says nothing about the residual any more.
  static constexpr double kNoWeight = 1e-12;

  std::ptrdiff_t First(int factor) const { return std::ptrdiff_t{factor} * residual_size(); }
  void ScaleJacobian(int factor, double scale);
  double TakeBackWeight(int factor);
  void Grow(int num_places);
  template <int kSize>
  void WeighCandidatesSized(int begin, int end);
  void WeighCandidates(int begin, int end);
  void Weigh(int factor);
  template <int kSize>
  double AcceptSized(const std::vector<std::int32_t>& factors);

  Linearization factors_;
  const Kernels* kernels_;
  bool constant_jacobian_;
  std::vector<double> predicted_f_;
  std::vector<double> J_step_;  // J δ of the step under construction
  std::vector<double> q_;
  std::vector<double> correction_;  // √β n of the factors that are corrected
  std::vector<double> candidate_q_;
  AlignedVector<State> states_;
  std::vector<Linearized> linearized_;
  // per factor: its last step changed its residual little, and nothing else has since
  std::vector<char> steady_;
  std::vector<std::int32_t> y_targets_;  // per factor and slot
  ParkedJacobians parked_;               // of factors that Reweigh has left without weight
};

}  // namespace inceres::internal
