#include "tools/sim/simulated_camera.h"

#include <cmath>

namespace inceres::internal {

void LookAround(double heading, int index, Random* random, SimulatedCamera* camera) {
  const double yaw = heading + 0.2 * PortableSin(0.7 * index) + 0.05 * random->Normal();
  const double pitch = 0.08 + 0.05 * random->Normal();
  const double roll = 0.05 * random->Normal();
  camera->R =
      (Rotation::AboutAxis(1, yaw) * Rotation::AboutAxis(0, pitch) * Rotation::AboutAxis(2, roll))
          .Inverse();
  camera->focal = 800.0 + 15.0 * random->Normal();
  camera->k1 = -0.05 + 0.005 * random->Normal();
  camera->k2 = 0.01 + 0.002 * random->Normal();
}

bool IsInImage(const SimulatedCamera& camera, const Vector3& position, double range) {
  const Vector3 ray = position - camera.center;
  if (Dot(ray, ray) > range * range) {
    return false;
  }
  const Vector3 p = camera.R * ray;
  const double depth = -p[2];
  return depth >= kMinDepth && std::abs(p[0]) <= kHalfWidth * depth &&
         std::abs(p[1]) <= kHalfHeight * depth;
}

}  // namespace inceres::internal
