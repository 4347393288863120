#pragma once

#include "base/executor.h"
#include "linearize/linearization.h"

namespace inceres::internal {

/// gradient += Σ J_iᵀ f_i over the factors [begin, end) of a family, whose Jacobians are there in
/// double; padded, by tangent offsets. Every variable's sum is taken by one task, in the order of
/// the factors: the same bits for any number of threads. Cost: a pass over these Jacobians, and one
/// over the tangent offsets for each of a few tasks.
void AddGradient(const Linearization& cache, int begin, int end, const Executor& executor,
                 double* gradient);

}  // namespace inceres::internal
