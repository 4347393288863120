#pragma once

#include <mpi.h>

#include <cstdint>
#include <string>
#include <vector>

#include "inceres/io/bal.h"
#include "inceres/io/read_options.h"
#include "inceres/status.h"

namespace inceres::tools {

/// An observation, and the how-many-th of the problem it is.
struct Seen {
  std::int64_t index = 0;
  std::int32_t camera = 0;
  std::int32_t point = 0;
  double x = 0.0;
  double y = 0.0;
};

/// A point and its values.
struct PlacedPoint {
  std::int64_t id = 0;
  double values[3] = {0.0, 0.0, 0.0};
};

/// Some points of a BAL problem with all their observations, and all its cameras.
struct Tracks {
  std::int64_t num_points = 0;        ///< of the problem
  std::int64_t num_observations = 0;  ///< of the problem
  std::vector<double> cameras;        ///< of the problem: nine each
  std::vector<PlacedPoint> points;    ///< by ascending id
  std::vector<Seen> seen;             ///< by point, then by index
  std::vector<std::size_t> begin;     ///< per point, one more: its stretch of `seen`

  int num_cameras() const { return static_cast<int>(cameras.size()) / BalProblem::kCameraSize; }
};

/// Reads a BAL file: each rank the numbers of its share of the bytes; of a compressed one rank 0
/// all of it. Each rank ends with the tracks of a stretch of points. Collective; an error is that
/// of ReadBal, on all ranks.
Status ReadTracks(MPI_Comm comm, const std::string& path, const ReadOptions& options,
                  Tracks* tracks);

/// The same of the problem that rank 0 has; those of the others are not read. Collective.
void TakeTracks(MPI_Comm comm, BalProblem bal, Tracks* tracks);

/// Sends each point, with its track, to a rank: target[i] of points[i]. Collective.
void MoveTracks(MPI_Comm comm, const std::vector<int>& target, Tracks* tracks);

/// The whole problem on rank 0, with its observations in their order. Collective.
BalProblem GatherProblem(MPI_Comm comm, const Tracks& tracks);

}  // namespace inceres::tools
