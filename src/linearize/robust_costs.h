#pragma once

#include "linearize/linearization.h"
#include "linearize/robustify.h"

namespace inceres::internal {

/// Factors per sum of costs, at most.
constexpr int kSumSize = 16;

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

}  // namespace inceres::internal
