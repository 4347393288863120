#include "linearize/robustify.h"

#include <algorithm>
#include <cmath>

namespace inceres::internal {
namespace {

// Most residuals are of size 1 or 2: without a loop.
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

// The padding is left alone.
void CorrectJacobian(double sqrt_rho1, double a, const double* f, int rows, const SlotJacobians& slot, int factor) {
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

// All at once: the padding is zero and stays so. But a loss that gives NaN must not outlive its evaluation.
void CorrectJacobians(double sqrt_rho1, double a, const double* f, int residual_size, int num_slots, const SlotJacobians* slots,
                      int factor, const std::int32_t* tangent_offsets) {
  if (std::isfinite(sqrt_rho1) && std::isfinite(a)) {
    return BestKernels().correct_factor(slots, num_slots, factor, tangent_offsets, f, residual_size, sqrt_rho1, a);
  }
  for (int k = 0; k < num_slots; ++k) {
    if (tangent_offsets[k] >= 0) {
      CorrectJacobian(sqrt_rho1, a, f, residual_size, slots[k], factor);
    }
  }
}

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

double RobustCost(const Loss* loss, const double* f, int residual_size) {
  const double s = SquaredNorm(f, residual_size);
  if (loss == nullptr) {
    return 0.5 * s;
  }
  double rho[3];
  loss->Evaluate(s, rho);
  return 0.5 * rho[0];
}

double RootOfCurvature(double s, const double* rho) {
  if (!(s > 0.0 && rho[1] > 0.0 && rho[2] < 0.0)) {
    return 1.0;
  }
  return std::sqrt(std::max(kLeastCurvature, 1.0 + 2.0 * s * rho[2] / rho[1]));
}

// With n = f/‖f‖ and (1 − α)² = 1 + 2 s ρ''/ρ', ρ' (I − α n nᵀ)² = ρ' I + 2 ρ'' f fᵀ, the loss's part of the Hessian. So
// J := √ρ' (I − α n nᵀ) J and f := √ρ' / (1 − α) f.
double RobustifyFactor(const Loss& loss, int residual_size, int num_slots, const SlotJacobians* slots, int factor,
                       const std::int32_t* tangent_offsets, bool reduces_curvature, double* f) {
  const double s = SquaredNorm(f, residual_size);
  double rho[3];
  loss.Evaluate(s, rho);
  const double sqrt_rho1 = std::sqrt(rho[1]);
  double root = 1.0;  // 1 − α
  if (s > 0.0 && rho[2] > 0.0) {
    root = std::sqrt(1.0 + 2.0 * s * rho[2] / rho[1]);
  } else if (reduces_curvature) {
    root = RootOfCurvature(s, rho);
  }
  const double residual_scale = sqrt_rho1 / root;
  const double a = root != 1.0 ? (1.0 - root) / s : 0.0;
  if (sqrt_rho1 != 1.0 || a != 0.0) {
    CorrectJacobians(sqrt_rho1, a, f, residual_size, num_slots, slots, factor, tangent_offsets);
    for (int i = 0; i < residual_size; ++i) {
      f[i] *= residual_scale;
    }
  }
  return 0.5 * rho[0];
}

}  // namespace inceres::internal
