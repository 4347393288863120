#pragma once

#include "common/run.h"
#include "okvis/okvis_estimator.h"

namespace sliding_window {

/// Plays an OkvisEstimator, with as many tracks in an image as give it the landmarks asked for.
RunReport RunOkvis(const RunOptions& options, const OkvisOptions& okvis_options,
                   const SolveFunction& solve);

}  // namespace sliding_window
