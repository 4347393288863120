#pragma once

#include "inceres/status.h"
#include "tools/sim/simulated_bal.h"

namespace inceres::tools {

/// Simulates the scene that the flags of bal_generate describe: a street, a city or a collection of
/// photos. Tells how far it is, where that takes long.
Status MakeScene(SimulatedBal* scene);

}  // namespace inceres::tools
