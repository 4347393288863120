#include "tools/sim/scene_noise.h"

#include <algorithm>
#include <cmath>

#include "tools/sim/random_subset.h"
namespace inceres::internal {
namespace {

// Streams of random numbers; 1 and 2 belong to the cameras and the points.
enum Stream : std::uint64_t { kPixelStream = 3, kCameraStream, kPointStream, kOutlierStream };

// R' = Exp(n) R about the camera's axes, center' = center + n.
void MoveCamera(const BalNoise& options, Random* random, double* camera) {
  const Rotation R = Rotation::FromAngleAxis({camera[0], camera[1], camera[2]});
  const Vector3 center = -1.0 * (R.Inverse() * Vector3{camera[3], camera[4], camera[5]});
  const Rotation moved = Rotation::FromAngleAxis(random->Normal3(options.rotation_noise)) * R;
  const Vector3 a = moved.ToAngleAxis();
  const Vector3 t = -1.0 * (moved * (center + random->Normal3(options.position_noise)));
  std::copy(a.begin(), a.end(), camera);
  std::copy(t.begin(), t.end(), camera + 3);
}

void PerturbCameras(const BalNoise& options, std::uint64_t seed, BalProblem* problem) {
  Random random(seed, kCameraStream);
  const bool moves = options.rotation_noise > 0.0 || options.position_noise > 0.0;
  for (int i = 0; i < problem->num_cameras; ++i) {
    double* camera = problem->CameraData(i);
    if (moves) {  // otherwise not even rounding
      MoveCamera(options, &random, camera);
    }
    const Vector3 intrinsics = random.Normal3(1.0);
    camera[6] *= 1.0 + std::clamp(options.focal_noise * intrinsics[0], -0.5, 0.5);
    camera[7] += options.distortion_noise * intrinsics[1];
    camera[8] += options.distortion_noise * intrinsics[2];
  }
}

void PerturbPoints(const BalNoise& options, std::uint64_t seed, BalProblem* problem) {
  Random random(seed, kPointStream);
  for (double& coordinate : problem->points) {
    coordinate += options.point_noise * random.Normal();
  }
}

void PerturbPixels(const BalNoise& options, std::uint64_t seed, BalProblem* problem) {
  Random random(seed, kPixelStream);
  for (BalObservation& observation : problem->observations) {
    observation.x += options.pixel_noise * random.Normal();
    observation.y += options.pixel_noise * random.Normal();
  }
}

void DisplaceOutliers(const BalNoise& options, std::uint64_t seed, BalProblem* problem,
                      std::vector<int>* outliers) {
  Random random(seed, kOutlierStream);
  std::vector<BalObservation>& observations = problem->observations;
  ForRandomSubset(options.outlier_fraction, observations.size(), &random, [&](std::size_t i) {
    observations[i].x += random.Uniform(-options.outlier_pixels, options.outlier_pixels);
    observations[i].y += random.Uniform(-options.outlier_pixels, options.outlier_pixels);
    outliers->push_back(static_cast<int>(i));
  });
}

}  // namespace

std::array<double, BalProblem::kCameraSize> ToBal(const SimulatedCamera& camera) {
  const Vector3 a = camera.R.ToAngleAxis();
  const Vector3 t = -1.0 * (camera.R * camera.center);
  return {a[0], a[1], a[2], t[0], t[1], t[2], camera.focal, camera.k1, camera.k2};
}

void ProjectAll(BalProblem* problem) {
  std::vector<Rotation> rotations;
  for (int i = 0; i < problem->num_cameras; ++i) {
    const double* camera = problem->CameraData(i);
    rotations.push_back(Rotation::FromAngleAxis({camera[0], camera[1], camera[2]}));
  }
  for (BalObservation& observation : problem->observations) {
    const double* camera = problem->CameraData(observation.camera);
    const double* X = problem->PointData(observation.point);
    const Rotation& R = rotations[static_cast<std::size_t>(observation.camera)];
    const Vector3 P = R * Vector3{X[0], X[1], X[2]} + Vector3{camera[3], camera[4], camera[5]};
    const double px = -P[0] / P[2], py = -P[1] / P[2];
    const double r2 = px * px + py * py;
    const double scale = camera[6] * (1.0 + r2 * (camera[7] + r2 * camera[8]));
    observation.x = scale * px;
    observation.y = scale * py;
  }
}

void AddNoise(const BalNoise& noise, std::uint64_t seed, BalProblem* problem,
              std::vector<int>* outliers) {
  PerturbCameras(noise, seed, problem);
  PerturbPoints(noise, seed, problem);
  PerturbPixels(noise, seed, problem);
  DisplaceOutliers(noise, seed, problem, outliers);
}

}  // namespace inceres::internal
