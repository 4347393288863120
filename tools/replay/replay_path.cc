#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "inceres/problem/rotation.h"
#include "tools/replay/replay_scripts.h"
#include "tools/sim/street_scene.h"

namespace inceres::tools {
namespace {

constexpr double kCircumference = 200.0;  // m, of the circuit
constexpr double kSpacing = 1.375;        // m between cameras: 16 of them within sight of a point
constexpr double kPointsPerCamera = 6.5;
// as drawn; 6.4 in the mean come out, for not every point has so many cameras about it
constexpr double kTrackLength = 7.0;
constexpr double kLoopFraction = 0.3;
constexpr double kLoopStretch = 0.1;  // of the circuit
constexpr int kMinCameras = 20;
constexpr int kLoopGap = 50;  // cameras; a point of the same lap stays in sight for fewer than 30

StreetSceneOptions SceneOptions(const PathReplayOptions& path) {
  StreetSceneOptions options;
  options.num_cameras = path.num_cameras;
  options.num_points = static_cast<int>(kPointsPerCamera * path.num_cameras);
  options.num_observations = 0;
  options.track_length = kTrackLength;
  options.laps = kSpacing * path.num_cameras / kCircumference;
  options.camera_spacing = kSpacing;
  options.loop_fraction = path.loops ? kLoopFraction : 0.0;
  options.loop_stretch = kLoopStretch;
  options.seed = path.seed;
  return options;
}

// Puts the origin into the middle of all points: X' = X − m, t' = t + R m leaves every projection
// as it is.
void Center(BalProblem* bal) {
  double middle[3] = {0.0, 0.0, 0.0};
  for (std::size_t i = 0; i < bal->points.size(); ++i) {
    middle[i % 3] += bal->points[i] / bal->num_points;
  }
  for (std::size_t i = 0; i < bal->points.size(); ++i) {
    bal->points[i] -= middle[i % 3];
  }
  for (int i = 0; i < bal->num_cameras; ++i) {
    double* camera = bal->CameraData(i);
    const RotationCoefficients k =
        CoefficientsOfAngle(camera[0] * camera[0] + camera[1] * camera[1] + camera[2] * camera[2]);
    double R[9], shift[3];
    RotationPolynomial(camera, k.sinc, k.cosc, R);
    MultiplyMatrixVector(R, middle, shift);
    for (int axis = 0; axis < 3; ++axis) {
      camera[3 + axis] += shift[axis];
    }
  }
}

}  // namespace

Status MakePathReplay(const PathReplayOptions& options, ReplayScript* script) {
  const int least =
      options.loops ? static_cast<int>(kCircumference / kSpacing) + kMinCameras : kMinCameras;
  if (options.num_cameras < least) {
    return Status::Error(
        StatusCode::kInvalidArgument,
        "a path of " + std::to_string(options.num_cameras) + " cameras: " +
            (options.loops ? "to close a loop it needs at least " : "it needs at least ") +
            std::to_string(least));
  }
  StreetScene scene;
  Status status = GenerateStreetScene(SceneOptions(options), &scene);
  if (!status.ok()) {
    return status;
  }
  BalProblem bal = std::move(scene.truth);
  bal.observations = std::move(scene.problem.observations);
  Center(&bal);
  BalReplayOptions protocol;
  protocol.free_intrinsics = options.free_intrinsics;
  protocol.priors = options.priors;
  protocol.seed = options.seed;
  protocol.loop_gap = kLoopGap;
  *script = MakeBalReplay(bal, protocol);
  script->description =
      "path of " + script->description + (options.loops ? ", a loop every lap" : ", no loops");
  return status;
}

}  // namespace inceres::tools
