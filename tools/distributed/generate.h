#pragma once

#include <mpi.h>

#include <string>

#include "inceres/status.h"
#include "tools/distributed/tracks.h"

namespace inceres::tools {

/// The problem of a preset of bal_generate, with what the flags say of it (scene_flags.h). Rank 0
/// makes it, and deals it out. Collective.
Status GenerateTracks(MPI_Comm comm, const std::string& preset, Tracks* tracks);

}  // namespace inceres::tools
