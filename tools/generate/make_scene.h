#pragma once

#include <string>

#include "inceres/status.h"
#include "tools/sim/simulated_bal.h"

namespace inceres::tools {

/// Simulates the scene of a preset ("": none) that the flags describe (scene_flags.h): a street, a
/// city or a collection of photos. Tells how far it is, where that takes long.
Status MakeScene(const std::string& preset, SimulatedBal* scene);

}  // namespace inceres::tools
