#pragma once

#include <vector>

#include "tools/sim/portable_math.h"

namespace inceres::internal {

/// One true camera of a simulation: world to camera is x_c = R (x - center), and it looks along
/// its negative z axis.
struct SimulatedCamera {
  Vector3 center{};
  Rotation R;
  double focal = 0.0, k1 = 0.0, k2 = 0.0;
};

/// Half the image of a camera that looks around, divided by its focal length: 42 degrees to the
/// sides, 35 up and down. And how near what it sees may be.
constexpr double kHalfWidth = 0.9, kHalfHeight = 0.7;
constexpr double kMinDepth = 2.0;

/// Lets the camera with this number look along the heading, a little upward and from side to side,
/// and gives it a focal length and a distortion.
void LookAround(double heading, int index, Random* random, SimulatedCamera* camera);

/// Whether the position is in the image of a camera that looks around, and not farther than this.
bool IsInImage(const SimulatedCamera& camera, const Vector3& position, double range);

/// One point and who could see it. The first candidate is the camera the point was made for, the
/// second sees it from a direction that is different enough, the others follow in random order: any
/// first k >= 2 of them are a valid track of length k.
struct CandidateTrack {
  Vector3 position{};
  std::vector<int> candidates;
};

/// Whether two cameras see the position from directions at least two degrees apart.
bool HaveParallax(const Vector3& center, const Vector3& other_center, const Vector3& position);

}  // namespace inceres::internal
