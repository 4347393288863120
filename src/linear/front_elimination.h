#pragma once

#include "base/executor.h"
#include "linear/front_tree.h"

namespace inceres::internal {

// What is done to one front of a multifrontal factorization, wherever it is kept: L are the columns
// of its pivots, `stride()` apart, U its update matrix, `update_stride()` apart, both column-major,
// of which the lower triangle counts. Source: Duff & Reid, ACM TOMS 9(3), 1983.

/// Column j of the whole front, counting rows from its first pivot.
inline double* FrontColumn(const Front& front, double* L, double* U, int j) {
  const int below = front.below();
  return j < below ? L + static_cast<std::ptrdiff_t>(j) * front.stride()
                   : U + static_cast<std::ptrdiff_t>(j - below) * front.update_stride() - below;
}

/// Zeros in all that is read of it.
void ZeroFront(const Front& front, double* L, double* U);

/// Adds the update matrix of a child, whose rows have these places in the front. Runs may come in
/// another order than in the child.
void AddUpdateMatrix(const Front& child, const double* child_update, const FrontRun* runs,
                     int num_runs, const Front& front, double* L, double* U);

/// L Lᵀ of the pivots, and what the other rows keep: U −= L₂ L₂ᵀ. The pivot that is not positive
/// and finite; -1: there is none. Large fronts are cut into strips, with the same bits.
int EliminateFront(const Front& front, double* L, double* U, const Executor& executor);

/// y has the front's rows: y₁ := L₁⁻¹ y₁, and y₂ −= L₂ y₁.
void SolveFrontForward(const Front& front, const double* L, double* y);
/// The same of several columns, of which a row has `lanes` entries, one after the other.
void SolveFrontForward(const Front& front, const double* L, int lanes, double* y);
/// y₁ := L₁⁻ᵀ (y₁ − L₂ᵀ y₂).
void SolveFrontBackward(const Front& front, const double* L, double* y);

}  // namespace inceres::internal
