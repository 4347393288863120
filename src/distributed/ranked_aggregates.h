#pragma once

#include "distributed/communicator.h"
#include "distributed/rank_sums.h"
#include "distributed/shared_frames.h"
#include "linear/aggregation.h"
#include "linearize/incidences.h"
#include "schur/frame_aggregates.h"

namespace inceres::internal {

/// Aggregates of the frames of all ranks, the same on all of them: those that one process would
/// find, from counts that the ranks add up. Cost: each rank's pairs of frames with something in
/// common go to all others, once. Made by all ranks together.
struct RankedAggregates {
  RankedAggregates(const Communicator& ranks, const SharedFrames& frames,
                   const Evaluator& evaluator, const LandmarkIncidences& incidences);

  SegmentSums by_frame;    // a segment for each frame of all ranks, by its number
  FrameAggregates all;     // by the numbers of frames
  FrameAggregates here;    // of the frames of the layout; aggregates keep their numbers
  FrameClusters by_owner;  // of these: those of an aggregate that one rank owns
};

}  // namespace inceres::internal
