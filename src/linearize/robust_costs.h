#pragma once

#include <algorithm>

#include "linearize/linearization.h"
#include "linearize/robustify.h"

namespace inceres::internal {

/// Factors per sum of costs, at most.
constexpr int kSumSize = 16;

/// Factors of a task that is to have so many, at most `most`: up to a multiple of kSumSize, so that
/// none of these sums is cut in two. `most` is one.
inline int InWholeSums(int task_size, int most) {
  return (std::clamp(task_size, 1, most) + kSumSize - 1) / kSumSize * kSumSize;
}

/// ½ Σ ρ of up to kSumSize factors [begin, end) of a family, in their order, where they were
/// evaluated last: at the candidate, or linearized. These are robustified on the way; `failure`
/// names one whose loss has no root, and all of them stay as they were.
///
/// `known_point`: the point was a candidate before. The values of losses are then those of
/// Linearization::loss_values wherever the residual has the same norm to the bit.
///
/// candidate_f: the residual of factor i at the candidate is at candidate_f + i · residual_size.
/// `places`: where they were linearized.
double SumCosts(bool linearized, bool known_point, LossCurvature curvature, int begin, int end,
                const double* candidate_f, const LinearizationPlaces& places, Linearization* family,
                EvaluationFailure* failure);

/// The same of any number of factors: one sum after the other, each of those up to a multiple of
/// kSumSize. Sums of groups behind a failure are not written.
void SumCostsByGroup(bool linearized, bool known_point, LossCurvature curvature, int begin, int end,
                     const double* candidate_f, const LinearizationPlaces& places,
                     Linearization* family, double* sums, EvaluationFailure* failure);

}  // namespace inceres::internal
