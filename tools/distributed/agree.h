#pragma once

#include <mpi.h>

#include "inceres/status.h"

namespace inceres::tools {

/// Ok if that of all ranks is; else that of the lowest one that is not. Collective.
Status Agree(MPI_Comm comm, const Status& own);

}  // namespace inceres::tools
