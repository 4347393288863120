#pragma once

#include <mpi.h>

#include <cstdint>
#include <string>
#include <vector>

#include "tools/distributed/tracks.h"

namespace inceres::tools {

/// Which rank each point goes to, and what that costs.
struct Partition {
  std::vector<int> target;            ///< per point here
  std::int64_t num_frame_copies = 0;  ///< pairs of a rank and a camera that its points see
  double imbalance = 1.0;             ///< the heaviest rank's predicted work over the mean
  std::string by;                     ///< what the cameras were ordered by
};

/// Points in the order of the middle one of their cameras, cut so that all ranks have as much work:
/// observations of a point, and `per_square` times their square. Cameras in the order of the file;
/// or in that of their parts in a partition of the camera graph by PT-Scotch, if that makes fewer
/// copies of frames (`by`: "order", "ptscotch", or "auto" for the better one). Collective.
Status PartitionTracks(MPI_Comm comm, const Tracks& tracks, const std::string& by,
                       double per_square, Partition* partition);

/// The part of each camera, by PT-Scotch: all of them on all ranks. An edge for cameras that follow
/// each other in a track, as heavy as there are such tracks. Collective.
Status PartitionCameras(MPI_Comm comm, const Tracks& tracks, std::vector<int>* part);

}  // namespace inceres::tools
