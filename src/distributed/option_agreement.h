#pragma once

#include "distributed/communicator.h"
#include "inceres/distributed/options.h"

namespace inceres::internal {

/// Valid on all ranks, and the same on all, but for what may differ. An error names the option and
/// two ranks. Collective.
Status AgreeOnOptions(const Communicator& ranks, const DistributedOptions& options);

}  // namespace inceres::internal
