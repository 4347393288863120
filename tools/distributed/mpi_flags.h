#pragma once

#include <memory>
#include <string>

#include "inceres/distributed/distributed_solver.h"
#include "inceres/problem/losses.h"
#include "inceres/status.h"

namespace inceres::tools {

/// What the flags of bal_solve_mpi say of the solve.
struct MpiSettings {
  DistributedOptions options;
  std::shared_ptr<const Loss> loss;
  std::string robust;     ///< as it was written
  std::string partition;  ///< auto, order or ptscotch
};

/// kInvalidArgument names the flag.
Status ReadMpiFlags(MpiSettings* settings);

}  // namespace inceres::tools
