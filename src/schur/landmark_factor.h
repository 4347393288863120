#pragma once

namespace inceres::internal {

/// The Cholesky factor of one landmark's block, size 1 to 4, rows four apart: U_inv = L⁻¹ with L Lᵀ = P + diag(damping). False if
/// a pivot is not positive and finite.
bool InvertCholeskyFactor(int size, const double* P, const double* damping, double* U_inv);

/// z = U_inv x and x = U_invᵀ y for the lower triangular U_inv.
void MultiplyLower(int size, const double* U_inv, const double* x, double* z);
void MultiplyLowerTransposed(int size, const double* U_inv, const double* y, double* x);

}  // namespace inceres::internal
