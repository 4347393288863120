#pragma once

#include <cstddef>
#include <cstdint>

#include "block/kernels.h"
#include "inceres/graph/loss.h"

namespace inceres::internal {

/// ½‖f‖² of all residuals of factors without a loss, one after the other: `count` entries.
double PlainCost(const double* f, std::ptrdiff_t count);

/// ½ρ(‖f‖²), or ½‖f‖² without a loss.
double RobustCost(const Loss* loss, const double* f, int residual_size);

/// The same, and scales f and the tangent Jacobians so that the rest of the solver sees a plain least-squares factor whose
/// gradient is the robust one and whose JᵀJ is the robust Gauss–Newton Hessian (algorithms.md section 6; Triggs 1999; the
/// clamping of the second-order term to ρ'' > 0 is Ceres's). A negative tangent offset marks a slot without a Jacobian.
double RobustifyFactor(const Loss& loss, int residual_size, int num_slots, const SlotJacobians* slots, int factor,
                       const std::int32_t* tangent_offsets, double* f);

/// J := √ρ' (I − a f fᵀ) J of one factor, for the slots with a tangent offset.
void CorrectJacobians(double sqrt_rho1, double a, const double* f, int residual_size, int num_slots, const SlotJacobians* slots,
                      int factor, const std::int32_t* tangent_offsets);

}  // namespace inceres::internal
