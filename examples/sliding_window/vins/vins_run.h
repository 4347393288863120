#pragma once

#include "common/run.h"

namespace sliding_window {

/// Plays a VinsEstimator, with as many tracks in an image as give it the features asked for.
RunReport RunVins(const RunOptions& options, const SolveFunction& solve);

}  // namespace sliding_window
