#pragma once

#include <cstddef>
#include <cstdint>

#include "inceres/problem/losses.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// ½‖f‖² of all residuals of factors without a loss, one after the other: `count` entries.
double PlainCost(const double* f, std::ptrdiff_t count);

/// ½ρ(‖f‖²), or ½‖f‖² without a loss.
double RobustCost(const Loss* loss, const double* f, int residual_size);

/// Of the curvature along f that ρ' alone gives, the share that stays at least: with less H loses its grip.
inline constexpr double kLeastCurvature = 0.5;

/// √(1 + 2 s ρ''/ρ'), the square root of the share of the curvature along f that a loss leaves where it takes some away, and at
/// least that of kLeastCurvature; 1 elsewhere. `rho` is what Loss::Evaluate gave for s.
double RootOfCurvature(double s, const double* rho);

/// The same, and scales f and the tangent Jacobians so that the rest of the solver sees a plain least-squares factor whose
/// gradient is the robust one and whose JᵀJ is the robust Gauss–Newton Hessian (docs/algorithms.md, "Robust losses"; Triggs
/// 1999). Its second-order term is taken where ρ'' > 0, as in Ceres, and with `reduces_curvature` where ρ'' < 0 too, down to
/// kLeastCurvature. A negative tangent offset marks a slot without a Jacobian.
double RobustifyFactor(const Loss& loss, int residual_size, int num_slots, const SlotJacobians* slots, int factor,
                       const std::int32_t* tangent_offsets, bool reduces_curvature, double* f);

/// J := √ρ' (I − a f fᵀ) J of one factor, for the slots with a tangent offset.
void CorrectJacobians(double sqrt_rho1, double a, const double* f, int residual_size, int num_slots, const SlotJacobians* slots,
                      int factor, const std::int32_t* tangent_offsets);

}  // namespace inceres::internal
