#pragma once

#include <cstddef>
#include <vector>

#include "simd/kernels.h"

namespace inceres::internal {

/// Jacobians that are kept in single precision, in double again for those who read doubles only.

/// C += Σ_p B_pᵀ A_p where A and B are in single precision; a and b of `products` are not read. As
/// b, null stands for a where the products are symmetric.
void AccumulateWidened(const Kernels& kernels, const BlockProducts& products, const float* a,
                       const float* b, double* C);

/// A record's block of a slot, so many rows: where it is, or widened to `scratch`.
const double* WidenedBlock(const SlotJacobians& slot, std::ptrdiff_t record, int num_rows,
                           std::vector<double>* scratch);

}  // namespace inceres::internal
