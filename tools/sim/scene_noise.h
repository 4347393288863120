#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "inceres/io/bal.h"
#include "tools/sim/bal_noise.h"
#include "tools/sim/simulated_camera.h"

namespace inceres::internal {

/// The nine BAL parameters of a true camera.
std::array<double, BalProblem::kCameraSize> ToBal(const SimulatedCamera& camera);

/// Fills in x and y of every observation from the cameras and points of the problem.
void ProjectAll(BalProblem* problem);

/// Start values and measurements from the truth, as the noise knobs say; `*outliers` are the
/// indices of the observations that are some, ascending.
void AddNoise(const BalNoise& noise, std::uint64_t seed, BalProblem* problem,
              std::vector<int>* outliers);

}  // namespace inceres::internal
