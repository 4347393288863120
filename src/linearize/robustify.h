#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "inceres/problem/losses.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// Most residuals are of size 1 or 2: without a loop.
inline double SquaredNorm(const double* f, int size) {
  double sum = f[0] * f[0];
  if (size == 2) {
    return sum + f[1] * f[1];
  }
  for (int i = 1; i < size; ++i) {
    sum += f[i] * f[i];
  }
  return sum;
}

/// A factor's loss at its residual f: ρ, ρ' and ρ'' at s = ‖f‖². Without a loss ρ(s) = s.
struct LossValue {
  LossValue() = default;
  LossValue(const Loss* loss, const double* f, int residual_size) {
    Set(loss, SquaredNorm(f, residual_size));
  }
  void Set(const Loss* loss, double squared_norm) {
    s = rho[0] = squared_norm;
    rho[1] = 1.0;
    rho[2] = 0.0;
    if (loss != nullptr) {
      loss->Evaluate(s, rho);
    }
  }

  double cost() const { return 0.5 * rho[0]; }
  double weight() const { return rho[1]; }
  /// Whether ρ' can weigh a factor: not below zero, and finite.
  bool HasWeight() const { return rho[1] >= 0.0 && rho[1] <= std::numeric_limits<double>::max(); }
  /// Whether the factor is that of a least-squares problem with ρ'' taken where it is positive: not
  /// where ρ'' > 0 and ρ' is not, on which Ceres aborts.
  bool HasRoot() const { return !(s > 0.0 && rho[2] > 0.0) || rho[1] > 0.0; }

  double s = -1.0;  // of no residual
  double rho[3] = {};
};

/// Why a factor cannot be linearized whose loss has none of LossValue::HasRoot.
inline constexpr char kLossWithoutRoot[] =
    "its loss has a second derivative above zero and a first one that is not";

/// Why one cannot whose ρ' is no weight.
inline constexpr char kLossWithoutWeight[] =
    "its loss has a first derivative below zero, or one that is not finite";

/// Which second-order terms of losses the Jacobians take.
enum class LossCurvature {
  kNone,
  kPositive,  ///< where ρ'' > 0, as in Ceres
  kNegative,  ///< where ρ'' < 0, down to kLeastCurvature
  kBoth,
};

/// Of the curvature along f that ρ' alone gives, the share that stays at least: with less H loses
/// its grip.
inline constexpr double kLeastCurvature = 0.5;

/// What makes a factor with a loss a plain least-squares one, whose gradient is the robust one and
/// whose JᵀJ is the robust Gauss–Newton Hessian (docs/algorithms.md, "Robust losses"; Triggs 1999):
///
///     J := √ρ' (I − α n nᵀ) J,   f := √ρ' / (1 − α) f,   n = f/‖f‖,   (1 − α)² = 1 + 2 s ρ''/ρ'
///
/// α is 0 where the second-order term is not taken. Entries are not finite where ρ' is negative, or
/// ρ'' > 0 is taken and LossValue::HasRoot() is false.
struct RobustScale {
  RobustScale(const LossValue& loss, LossCurvature curvature);

  bool is_one() const { return sqrt_weight == 1.0 && alpha_over_s == 0.0; }
  bool is_corrected() const { return root != 1.0; }
  bool is_finite() const { return std::isfinite(sqrt_weight) && std::isfinite(alpha_over_s); }
  /// Of J.
  FactorScale jacobian() const { return {sqrt_weight, alpha_over_s}; }
  /// Of f.
  double residual() const { return sqrt_weight / root; }
  /// Scales the tangent Jacobians of one factor; f as it was evaluated. A negative tangent offset
  /// marks a slot without one.
  void Apply(const double* f, int residual_size, int num_slots, const SlotJacobians* slots,
             int factor, const std::int32_t* tangent_offsets) const;

  double sqrt_weight = 1.0;   // √ρ'
  double root = 1.0;          // 1 − α
  double alpha_over_s = 0.0;  // so that α n nᵀ is this f fᵀ
};

// With (1 − α)² = 1 + 2 s ρ''/ρ', ρ' (I − α n nᵀ)² = ρ' I + 2 ρ'' f fᵀ, the loss's part of the
// Hessian.
// root > 1, α < 0 where ρ'' > 0: the Hessian gains curvature along f. At f = 0 there is no
// direction n, and no term.
inline RobustScale::RobustScale(const LossValue& loss, LossCurvature curvature)
    : sqrt_weight(std::sqrt(loss.rho[1])) {
  const double s = loss.s;
  const double rho1 = loss.rho[1];
  const double rho2 = loss.rho[2];
  // Here ρ' is not asked to be positive: HasRoot() says whether it is, and who has no answer to
  // that gets a root that is infinite, and J that is NaN.
  if (rho2 > 0.0 && s > 0.0 &&
      (curvature == LossCurvature::kPositive || curvature == LossCurvature::kBoth)) {
    root = std::sqrt(1.0 + 2.0 * s * rho2 / rho1);
  } else if (rho2 < 0.0 && s > 0.0 && rho1 > 0.0 &&
             (curvature == LossCurvature::kNegative || curvature == LossCurvature::kBoth)) {
    root = std::sqrt(std::max(kLeastCurvature, 1.0 + 2.0 * s * rho2 / rho1));
  }
  // α n nᵀ = (α / s) f fᵀ: without the root of s.
  alpha_over_s = root != 1.0 ? (1.0 - root) / s : 0.0;
}

/// J := (I + m mᵀ) J of one factor and slot: takes I − α n nᵀ back, for m = √β n and β = α/(1 − α).
void TakeBackCorrection(const double* m, int residual_size, const SlotJacobians& slot, double* J);

/// ½‖f‖² of all residuals of factors without a loss, one after the other: `count` entries.
double PlainCost(const double* f, std::ptrdiff_t count);

/// Scales f and the tangent Jacobians (RobustScale), for the value of the factor's loss at f.
void RobustifyFactor(const LossValue& value, int residual_size, int num_slots,
                     const SlotJacobians* slots, int factor, const std::int32_t* tangent_offsets,
                     LossCurvature curvature, double* f);

}  // namespace inceres::internal
