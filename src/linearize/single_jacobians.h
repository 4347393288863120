#pragma once

#include <cstddef>
#include <vector>

#include "base/executor.h"
#include "linearize/linearization.h"
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

/// gradient += Σ J_iᵀ f_i over the factors [begin, end) of a family, whose Jacobians are there in
/// double; padded, by tangent offsets. Every variable's sum is taken by one task, in the order of
/// the factors: the same bits for any number of threads. Cost: a pass over these Jacobians, and one
/// over the tangent offsets for each of a few tasks.
void AddGradient(const Linearization& cache, int begin, int end, const Executor& executor,
                 double* gradient);

}  // namespace inceres::internal
