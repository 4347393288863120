#pragma once

#include "adapters/ceres/plan/landmark_selection.h"
#include "src/base/available_memory.h"

namespace inceres::internal {

/// Takes back those landmarks of a selection whose elimination costs more than it saves, because it
/// couples all the frames of a landmark to each other: a few points seen by hundreds of cameras
/// make S full, while next to the cameras they leave it nearly empty, and its sparse factorization
/// then eliminates the cameras first, in effect.
///
/// What may stay is as little as the frames are: all landmarks, or those that meet at least 1/2,
/// 1/4 or 1/8 of the unknowns of the frames, as long as they have no more unknowns together than
/// these. For each such choice elimination and factorization are predicted, the latter by the
/// symbolic analysis of the block pattern; the cheapest is taken, the selection itself unless it
/// takes a fifth more. Where memory is short, so is the cheapest of those that fit; where none
/// does, `obstacle` says so.
///
/// Cost: nothing for S of up to 300 unknowns, linear where S is cheap to factor for another reason,
/// else the pairs of frames that landmarks bring and half a microsecond a block of S: less than one
/// step of the solver that is spared.
void KeepLongTracks(const ProblemView& view, const AvailableMemory& available,
                    LandmarkSelection* selection);

}  // namespace inceres::internal
