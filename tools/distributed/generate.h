#pragma once

#include <mpi.h>

#include <string>

#include "inceres/status.h"
#include "tools/distributed/tracks.h"

namespace inceres::tools {

/// The problem of a preset of bal_generate. Every rank makes all of it, and keeps its share.
/// Collective.
Status GenerateTracks(MPI_Comm comm, const std::string& preset, Tracks* tracks);

}  // namespace inceres::tools
