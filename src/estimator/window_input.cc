#include "estimator/window_input.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <string>

#include "base/option_rules.h"
#include "problem/find_fault.h"

// Checks of the options, and of what a caller passes with each frame. They come before any change,
// so that bad input costs one call and no state; messages about a frame begin with its time.
// Comparisons are written so that NaN fails them.

namespace inceres {
namespace internal {
namespace {

// Fifteen digits: of times in seconds since 1970 the usual six would not show a difference.
std::string Text(double value) {
  std::ostringstream text;
  text.precision(15);
  text << value;
  return text.str();
}

Status InvalidFrame(double time, const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, "frame at " + Text(time) + " s: " + what);
}

template <typename Values>
bool IsFinite(const Values& values) {
  return AllFinite(std::data(values), std::size(values));
}

bool IsPositive(double value) {
  return value > 0.0 && std::isfinite(value);
}

// Standard deviations are divided by: zero is as bad as a negative one, and infinity would whiten
// to nothing.
template <typename Values>
bool AllPositive(const Values& values) {
  return std::all_of(std::begin(values), std::end(values), IsPositive);
}

// Of [p(3), q(x, y, z, w)]. Of the squared length, 1 ± 1e-6: what single precision leaves is
// accepted, a forgotten normalization is not.
bool HasUnitQuaternion(const std::array<double, 7>& pose) {
  double norm = 0.0;
  for (std::size_t k = 3; k < 7; ++k) {
    norm += pose[k] * pose[k];
  }
  return std::fabs(norm - 1.0) < 1e-6;
}

Status CheckCamera(const std::array<double, 7>& pose) {
  if (!IsFinite(pose)) {
    return Invalid("SlidingWindowOptions: body_from_camera is not finite");
  }
  return HasUnitQuaternion(pose)
             ? Status::Ok()
             : Invalid(
                   "SlidingWindowOptions: the quaternion of body_from_camera is not of unit "
                   "length");
}

// The manifold of the window's poses is PoseManifold, R Exp(φ); an IMU factor in the other
// convention would have Jacobians of other coordinates.
Status CheckPerturbation(const ImuConventions& conventions) {
  return conventions.perturbation == ImuConventions::Perturbation::kRight
             ? Status::Ok()
             : Invalid(
                   "SlidingWindowOptions: imu.conventions.perturbation is kLeft; the reprojections "
                   "are written for kRight");
}

}  // namespace

Status CheckStart(const WindowStart& start) {
  const WindowState& state = start.state;
  if (!std::isfinite(state.time) || !IsFinite(state.pose) || !IsFinite(state.velocity) ||
      !IsFinite(state.gyr_bias) || !IsFinite(state.acc_bias)) {
    return InvalidFrame(state.time, "the state at the start is not finite");
  }
  if (!HasUnitQuaternion(state.pose)) {
    return InvalidFrame(state.time, "the quaternion at the start is not of unit length");
  }
  if (!AllPositive(start.pose_sigma) || !AllPositive(start.velocity_sigma) ||
      !AllPositive(start.gyr_bias_sigma) || !AllPositive(start.acc_bias_sigma)) {
    return InvalidFrame(state.time, "a standard deviation of the start is not positive and finite");
  }
  return Status::Ok();
}

// Twice the same track in one image would give a landmark two views from one camera at one time,
// which count as information and are a tracker's mistake.
Status CheckObservations(double time, const std::vector<WindowObservation>& observations) {
  std::vector<std::int64_t> tracks;
  for (const WindowObservation& seen : observations) {
    // Points are in the plane z = 1 and may lie far out: any finite value is possible.
    if (!IsFinite(seen.point)) {
      return InvalidFrame(
          time, "the observation of track " + std::to_string(seen.track) + " is not finite");
    }
    tracks.push_back(seen.track);
  }
  // Sorted to find duplicates in O(n log n) and to name the smallest, whatever the order of the
  // input.
  std::sort(tracks.begin(), tracks.end());
  const auto twice = std::adjacent_find(tracks.begin(), tracks.end());
  return twice == tracks.end()
             ? Status::Ok()
             : InvalidFrame(time, "track " + std::to_string(*twice) + " is observed twice");
}

// Whether observations belong to known tracks does not matter, for a track may begin in any frame.
Status CheckFrame(double last_time, const WindowFrame& frame) {
  if (!std::isfinite(frame.time)) {
    return InvalidFrame(frame.time, "its time is not finite");
  }
  if (!(frame.time > last_time)) {
    return InvalidFrame(frame.time,
                        "does not come after the last one, at " + Text(last_time) + " s");
  }
  return CheckObservations(frame.time, frame.observations);
}

}  // namespace internal

// The order of the checks is that of the header, and the first culprit is the one named. What is
// delegated (IMU, solver, marginalization) names its own.
Status SlidingWindowOptions::Validate() const {
  using internal::IsPositive;
  // Of divisors, of which zero is as bad as a negative number: whitening takes 1 / sigma, and a
  // track without parallax has no depth. Infinity is allowed in the others, and means never or
  // always.
  constexpr const char* kPositive = "positive and finite";
  return internal::OptionRules("SlidingWindowOptions")
      .Require(size >= 3 && size <= 1000, "size", size, "between 3 and 1000")
      .NotNegative("min_tracked", min_tracked)
      .NotNegative("min_parallax", min_parallax)
      .Require(IsPositive(feature_sigma[0]), "feature_sigma[0]", feature_sigma[0], kPositive)
      .Require(IsPositive(feature_sigma[1]), "feature_sigma[1]", feature_sigma[1], kPositive)
      .Require(IsPositive(min_triangulation_parallax), "min_triangulation_parallax",
               min_triangulation_parallax, kPositive)
      .Positive("max_imu_seconds", max_imu_seconds)
      .Positive("max_mean_error", max_mean_error)
      .Also(internal::CheckPerturbation(imu.conventions))
      .Also(internal::CheckCamera(body_from_camera))
      .Also(imu.Validate())
      .Also(solver.Validate())
      .Also(marginalization.Validate())
      .status();
}

}  // namespace inceres
