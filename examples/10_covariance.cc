// Lesson 10, covariance: how well a point ten meters away is known, by the distance of the two
// cameras that see it; and whether that is true, by measuring a thousand times.
//
//     10_covariance
#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>

#include "examples/noise.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/solver/covariance.h"
#include "inceres/solver/solver.h"

namespace {

Noise noise(10);

constexpr double kPoint[3] = {0.0, 0.0, 10.0};  // in the frame of the first camera, z ahead
constexpr double kSigma = 0.5;                  // pixels

struct Estimate {
  double x = 0.0, z = 0.0;              // meters
  double sigma_x = 0.0, sigma_z = 0.0;  // what GraphCovariance says of them
};

// Two cameras a baseline apart, each with a noisy sight of the point.
bool Triangulate(double baseline, Estimate* estimate) {
  // [quoted in docs/lessons/10_covariance.md]
  inceres::PinholeCamera camera;
  camera.f_x = camera.f_y = 500.0;
  inceres::FactorGraph graph;
  const auto sights = graph.AddFamily(std::make_shared<inceres::PointReprojectionFamily>(camera));
  const auto point = graph.AddVariable(kPoint, 3, inceres::Role::kLandmark);
  const double on_body[7] = {0, 0, 0, 0, 0, 0, 1};
  const auto camera_on_body = graph.AddBorrowedConstant(on_body, 7);
  const double poses[2][7] = {{0, 0, 0, 0, 0, 0, 1}, {baseline, 0, 0, 0, 0, 0, 1}};
  for (const auto& pose : poses) {
    inceres::PixelObservation seen;
    seen.pixel[0] = 500.0 * (kPoint[0] - pose[0]) / kPoint[2] + noise.Normal(kSigma);
    seen.pixel[1] = noise.Normal(kSigma);
    seen.sqrt_information[0] = seen.sqrt_information[2] = 1.0 / kSigma;  // whitened
    graph.AddFactor(sights, seen, {graph.AddBorrowedConstant(pose, 7), camera_on_body, point});
  }
  if (!inceres::Solve(inceres::SolverOptions(), &graph).IsSolutionUsable()) {
    return false;
  }
  inceres::GraphCovariance covariance;
  double block[9];
  const inceres::Status status = covariance.Compute(graph, {{point, point}});
  if (!status.ok() || !covariance.Get(point, point, block)) {
    std::cerr << status.message << '\n';  // which variable is not determined
    return false;
  }
  // [end of quote]
  *estimate = {graph.Values(point)[0], graph.Values(point)[2], std::sqrt(block[0]),
               std::sqrt(block[8])};
  return true;
}

}  // namespace

int main() {
  constexpr int kRounds = 1000;
  std::printf("            across                along the view\n");
  std::printf("baseline    predicted  measured   predicted  measured\n");
  for (const double baseline : {0.25, 0.5, 1.0, 2.0}) {
    double x2 = 0.0, z2 = 0.0, sigma_x = 0.0, sigma_z = 0.0;
    for (int round = 0; round < kRounds; ++round) {
      Estimate estimate;
      if (!Triangulate(baseline, &estimate)) {
        return 1;
      }
      x2 += (estimate.x - kPoint[0]) * (estimate.x - kPoint[0]) / kRounds;
      z2 += (estimate.z - kPoint[2]) * (estimate.z - kPoint[2]) / kRounds;
      sigma_x += estimate.sigma_x / kRounds;
      sigma_z += estimate.sigma_z / kRounds;
    }
    std::printf("%6.2f m    %7.4f m %8.4f m  %7.4f m %8.4f m\n", baseline, sigma_x, std::sqrt(x2),
                sigma_z, std::sqrt(z2));
  }
  return 0;
}
