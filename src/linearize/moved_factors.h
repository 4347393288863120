#pragma once

#include "inceres/problem/factor_family.h"

namespace inceres::internal {

/// After a batch was linearized where its variables are pinned: the residuals where the variables are, at `parameters`, of its
/// factors for which is_pinned(i) holds.
template <typename IsPinned>
EvaluationFailure EvaluateMoved(const FactorFamily& family, FactorBatch batch, const double* const* parameters,
                                const IsPinned& is_pinned) {
  batch.parameters = parameters;
  batch.tangent_maps = nullptr;
  batch.jacobians = nullptr;
  EvaluationFailure failure;
  for (int i = batch.begin, end = batch.end; i < end && !failure.failed(); ++i) {
    if (is_pinned(i)) {
      batch.begin = i;
      batch.end = i + 1;
      failure = family.Evaluate(batch);
    }
  }
  return failure;
}

}  // namespace inceres::internal
