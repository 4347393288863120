#include "tools/sim/simulated_bal.h"

#include <utility>

#include "tools/sim/scene_noise.h"

namespace inceres {

void SimulatedBal::BecomeTruth() {
  problem.cameras = std::move(true_cameras);
  problem.points = std::move(true_points);
  internal::ProjectAll(&problem);
}

double SimulatedBal::RmsAtTruth() {
  problem.cameras.swap(true_cameras);
  problem.points.swap(true_points);
  const double rms = ReprojectionRms(problem);
  problem.cameras.swap(true_cameras);
  problem.points.swap(true_points);
  return rms;
}

}  // namespace inceres
