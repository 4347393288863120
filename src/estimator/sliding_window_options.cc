#include <cmath>
#include <string>
#include <utility>

#include "estimator/window_input.h"
#include "inceres/estimator/sliding_window_estimator.h"
#include "problem/find_fault.h"

// Checks of the window's options; what is delegated (IMU, solver, marginalization) names its own
// culprit. All comparisons are written so that NaN fails them: "not positive" instead of "less than
// or equal to zero".

namespace inceres {
namespace {

Status Invalid(std::string message) {
  return Status::Error(StatusCode::kInvalidArgument, "SlidingWindowOptions: " + std::move(message));
}

bool IsPositive(double value) {
  return value > 0.0 && std::isfinite(value);
}

// Also of infinity, which means never or always.
bool IsNotNegative(double value) {
  return value >= 0.0;
}

Status ValidateCamera(const std::array<double, 7>& pose) {
  if (!internal::AllFinite(pose.data(), pose.size())) {
    return Invalid("body_from_camera is not finite");
  }
  return internal::HasUnitQuaternion(pose)
             ? Status::Ok()
             : Invalid("the quaternion of body_from_camera is not of unit length");
}

}  // namespace

// The order of the checks is that of the header, and the first culprit is the one named.
Status SlidingWindowOptions::Validate() const {
  if (size < 3 || size > 1000) {
    return Invalid("size is " + std::to_string(size) + ", not between 3 and 1000");
  }
  if (min_tracked < 0 || !IsNotNegative(min_parallax)) {
    return Invalid("min_tracked and min_parallax must not be negative");
  }
  // Divisors, so that zero is as bad as a negative number: whitening takes 1 / sigma, and a track
  // without parallax has no depth.
  const std::pair<const char*, double> positive[] = {
      {"feature_sigma[0]", feature_sigma[0]},
      {"feature_sigma[1]", feature_sigma[1]},
      {"min_triangulation_parallax", min_triangulation_parallax}};
  for (const auto& [name, value] : positive) {
    if (!IsPositive(value)) {
      return Invalid(std::string(name) + " must be positive and finite");
    }
  }
  // Infinity is allowed in both and means never.
  if (!(max_imu_seconds > 0.0) || !(max_mean_error > 0.0)) {
    return Invalid("max_imu_seconds and max_mean_error must be positive");
  }
  // The manifold of the window's poses is PoseManifold, R Exp(φ); an IMU factor in the other
  // convention would have Jacobians of other coordinates.
  if (imu.conventions.perturbation != ImuConventions::Perturbation::kRight) {
    return Invalid(
        "imu.conventions.perturbation is kLeft; the reprojections are written for kRight");
  }
  Status status = ValidateCamera(body_from_camera);
  status = status.ok() ? imu.Validate() : status;
  status = status.ok() ? solver.Validate() : status;
  return status.ok() ? marginalization.Validate() : status;
}

}  // namespace inceres
