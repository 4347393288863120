#include "linearize/robustify.h"

#include <algorithm>
#include <cmath>

namespace inceres::internal {

// Triggs's correction of a factor for its loss (docs/algorithms.md, "Robust losses"; Triggs et al.
// 1999, section 4.3; Ceres's Corrector for ρ'' > 0). With s = ‖f‖² and n = f/‖f‖,
//
//     J := √ρ' (I − α n nᵀ) J,    f := √ρ' / (1 − α) f,    (1 − α)² = 1 + 2 s ρ''/ρ',
//
// makes JᵀJ the robust Gauss–Newton Hessian, and Jᵀf the robust gradient whatever α is, for
// (I − α n nᵀ) f = (1 − α) f. Which sign of ρ'' counts is the caller's choice: Ceres takes ρ'' > 0
// alone; ρ'' < 0 is bounded so that half of the curvature along n stays.
//
// J is projected to the tangent space before and corrected here, which is Ceres's order and decides
// the last bits. f is needed as it was evaluated, so J comes first.

namespace {

// The padding is left alone.
// Entry by entry, for scales that are not finite: 0 · NaN in the padding would stay there after the
// loss has become ordinary again.
void CorrectJacobian(double sqrt_rho1, double a, const double* f, int rows,
                     const SlotJacobians& slot, int factor) {
  double* J = slot.data + factor * slot.factor_stride;
  const int row_stride = slot.row_stride;
  for (int c = 0; c < slot.columns; ++c) {
    double f_J = 0.0;
    for (int r = 0; r < rows && a != 0.0; ++r) {
      f_J += f[r] * J[r * row_stride + c];
    }
    for (int r = 0; r < rows; ++r) {
      J[r * row_stride + c] = sqrt_rho1 * (J[r * row_stride + c] - a * f[r] * f_J);
    }
  }
}

}  // namespace

// All at once: the padding is zero and stays so. But a loss that gives NaN must not outlive its
// evaluation.
void RobustScale::Apply(const double* f, int residual_size, int num_slots,
                        const SlotJacobians* slots, int factor,
                        const std::int32_t* tangent_offsets) const {
  if (is_finite()) {
    const FactorScale scale = jacobian();
    return BestKernels().correct_factors(slots, num_slots, factor, 1, tangent_offsets, f,
                                         residual_size, &scale);
  }
  for (int k = 0; k < num_slots; ++k) {
    if (tangent_offsets[k] >= 0) {
      CorrectJacobian(sqrt_weight, alpha_over_s, f, residual_size, slots[k], factor);
    }
  }
}

// (I − α n nᵀ)⁻¹ = I + β n nᵀ with β = α/(1 − α), column by column. The padding is zero and is not
// touched.
void TakeBackCorrection(const double* m, int residual_size, const SlotJacobians& slot, double* J) {
  for (int c = 0; c < slot.columns; ++c) {
    double along = 0.0;
    for (int r = 0; r < residual_size; ++r) {
      along += m[r] * J[r * slot.row_stride + c];
    }
    for (int r = 0; r < residual_size; ++r) {
      J[r * slot.row_stride + c] += along * m[r];
    }
  }
}

// Four sums side by side hide the latency of an addition; their order is fixed, so the bits depend
// on the count alone.
double PlainCost(const double* f, std::ptrdiff_t count) {
  constexpr std::ptrdiff_t kLanes = 4;
  double sums[kLanes] = {};
  std::ptrdiff_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    for (std::ptrdiff_t lane = 0; lane < kLanes; ++lane) {
      sums[lane] += f[i + lane] * f[i + lane];
    }
  }
  for (; i < count; ++i) {
    sums[0] += f[i] * f[i];
  }
  return 0.5 * ((sums[0] + sums[1]) + (sums[2] + sums[3]));
}

// A factor without a loss, or whose loss is ρ(s) = s at this residual, keeps its bits.
void RobustifyFactor(const LossValue& value, int residual_size, int num_slots,
                     const SlotJacobians* slots, int factor, const std::int32_t* tangent_offsets,
                     LossCurvature curvature, double* f) {
  const RobustScale scale(value, curvature);
  if (!scale.is_one()) {
    scale.Apply(f, residual_size, num_slots, slots, factor, tangent_offsets);
    const double residual_scale = scale.residual();
    for (int i = 0; i < residual_size; ++i) {
      f[i] *= residual_scale;
    }
  }
}

}  // namespace inceres::internal
