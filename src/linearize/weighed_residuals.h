#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "linearize/linearization.h"

namespace inceres::internal {

/// The residuals of one family's factors as their losses weigh them, now and at the candidate, and
/// as the last linearization predicts them (docs/algorithms.md, "Linearization" and "Robust
/// losses"); by the places of the factors. Of each factor:
///
///     f̂ = f at the linearization + what the cached J has predicted since,
///     q = w' (I + β n nᵀ) f / √w,    β = α / (1 − α),    (I − α n nᵀ)⁻¹ = I + β n nᵀ,
///
/// where w = ρ', n = f/‖f‖ and α are those of the linearization, and w' = ρ' now: Jᵀq is the
/// robust gradient at the present f. ‖f − f̂‖ is the error of the old linearization, known for
/// nothing; it is zero by definition where the family's Jacobian is constant.
///
/// α takes the second-order term of losses with ρ'' < 0, as far as H stays well-conditioned (Triggs
/// et al., "Bundle Adjustment: A Modern Synthesis", 1999, section 4.3): without it each step falls
/// short by what the outliers let it, and the steps converge linearly. It is 0 unless the factor's
/// last step has changed its residual little, for far from the minimum the curvature at a point
/// tells little of a robust loss; and where ρ'' ≥ 0.
class WeighedResiduals {
 public:
  explicit WeighedResiduals(const FactorFamily& family)
      : size_(family.residual_size()), constant_jacobian_(family.HasConstantJacobian()) {}

  bool constant_jacobian() const { return constant_jacobian_; }

  void Grow(int num_places, int capacity);
  /// The factor at this place is gone, or not linearized.
  void Forget(int factor) { linearized_[factor] = Linearized::kNot; }
  /// Its residual is another than its last step has led to: the next linearization takes no
  /// second-order term.
  void Unsettle(int factor) { steady_[factor] = 0; }
  void UnsettleAll() { std::fill(steady_.begin(), steady_.end(), 0); }

  /// Of a factor that was linearized: f̂ = f, w, q and the cost. Returns what its J is to be
  /// multiplied by.
  RobustScale Weigh(const Linearization& factors, int factor);
  /// Cost, w and q of candidates that were evaluated.
  void WeighCandidates(const Linearization& factors, int begin, int end);
  /// Of a factor whose loss is another one, `value` at f, which has left J := √w J_plain.
  void Reweigh(int factor, const LossValue& value, const double* f);
  /// The step tried last was accepted: f := candidate f, f̂ += (I + β n nᵀ) J δ / √w, q :=
  /// candidate q. Returns the change of the cost.
  double Accept(const std::vector<std::int32_t>& list, Linearization* factors);

  /// ½ρ at the candidate / now, and Σ of the first less the second.
  double CandidateCost(int factor) const { return states_[factor].candidate_cost; }
  double Cost(int factor) const { return states_[factor].cost; }
  double CandidateChange(const std::vector<std::int32_t>& list) const;

  /// J δ of the step under construction, for its maker to write.
  double* step_products() { return J_step_.data(); }
  /// −Σ (Jδ)ᵀ (q + ½ Jδ), the model decrease of that step.
  double PredictedDecrease(const std::vector<std::int32_t>& list) const;
  /// Of one factor: −qᵀJδ and ‖Jδ‖².
  void Slope(int factor, double* slope, double* curvature) const;
  /// Of one factor, once its candidate is weighed: by how much its cost rises more, or falls less,
  /// than its linearization predicts.
  double UnforeseenCost(int factor) const;

  const double* q() const { return q_.data(); }
  const double* q(int factor) const { return q_.data() + First(factor); }
  const double* candidate_q() const { return candidate_q_.data(); }
  /// ρ' now.
  double weight(int factor) const { return states_[factor].w; }
  /// 1/√w of the linearization; 0 if there was no weight to speak of.
  double inverse_sqrt_w(int factor) const { return states_[factor].inverse_sqrt_w; }
  /// √w of which that is so: the linearization says nothing about the residual any more.
  static bool IsNoWeight(double sqrt_w) { return !(sqrt_w > 1e-12); }

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
  /// Whether α ≠ 0: then its Jacobian is not √w times the plain one.
  bool IsCorrected(int factor) const { return linearized_[factor] == Linearized::kCorrected; }
  /// m = √β n of a factor that is corrected: the plain √w J is (I + m mᵀ) times the one kept.
  const double* correction(int factor) const { return correction_.data() + First(factor); }

  std::size_t Bytes() const;

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

  std::ptrdiff_t First(int factor) const { return std::ptrdiff_t{factor} * size_; }
  template <typename Size>
  void WeighCandidatesSized(Size size, const Linearization& factors, int begin, int end);
  template <typename Size>
  double AcceptSized(Size size, const std::vector<std::int32_t>& list, Linearization* factors);

  int size_;  // of a residual
  bool constant_jacobian_;
  std::vector<double> predicted_f_;
  std::vector<double> J_step_;
  std::vector<double> q_;
  std::vector<double> correction_;  // of the factors that are corrected
  std::vector<double> candidate_q_;
  AlignedVector<State> states_;
  std::vector<Linearized> linearized_;
  // per factor: its last step changed its residual little, and nothing else has since
  std::vector<char> steady_;
};

}  // namespace inceres::internal
