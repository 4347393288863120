#pragma once

#include "linearisation/evaluator.h"

namespace inceres::internal {

/// −(Jv)ᵀ(f + Jv/2) and ‖Jv‖² for a packed tangent vector v: one pass over the Jacobians, summed over fixed chunks.
RowProducts MultiplyJacobian(const Evaluator& evaluator, const double* v);

}  // namespace inceres::internal
