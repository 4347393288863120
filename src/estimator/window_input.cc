#include "estimator/window_input.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "problem/find_fault.h"

// Checks of what a caller passes with each frame. They come before any change, so that bad input
// costs one call and no state; each message has the time of the frame and what is wrong in it.
// Comparisons are written so that NaN fails them.

namespace inceres::internal {
namespace {

// Fifteen digits: of times in seconds since 1970 the usual six would not show a difference.
std::string Text(double value) {
  std::ostringstream text;
  text.precision(15);
  text << value;
  return text.str();
}

Status Invalid(double time, const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, "frame at " + Text(time) + " s: " + what);
}

template <typename Values>
bool IsFinite(const Values& values) {
  return AllFinite(std::data(values), std::size(values));
}

// Standard deviations are divided by: zero is as bad as a negative one, and infinity would whiten
// to nothing.
template <typename Values>
bool AllPositive(const Values& values) {
  return std::all_of(std::begin(values), std::end(values),
                     [](double value) { return value > 0.0 && std::isfinite(value); });
}

// Whether samples reach from the last frame to this one is for InterpolateImuSamples to say.
Status CheckSamples(double time, const std::vector<ImuSample>& samples) {
  if (samples.empty()) {
    return Invalid(time, "no IMU samples lead to it");
  }
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const ImuSample& sample = samples[i];
    if (!std::isfinite(sample.time) || !IsFinite(sample.gyr) || !IsFinite(sample.acc)) {
      return Invalid(time, "IMU sample " + std::to_string(i) + " is not finite");
    }
    // Strictly later: an interval of zero length would have infinite noise density.
    if (i > 0 && !(sample.time > samples[i - 1].time)) {
      return Invalid(time, "IMU sample " + std::to_string(i) + ", at " + Text(sample.time) +
                               " s, does not come after the one at " + Text(samples[i - 1].time) +
                               " s");
    }
  }
  return Status::Ok();
}

}  // namespace

// Of the squared length, 1 ± 1e-6: what single precision leaves is accepted, a forgotten
// normalization is not.
bool HasUnitQuaternion(const std::array<double, 7>& pose) {
  double norm = 0.0;
  for (std::size_t k = 3; k < 7; ++k) {
    norm += pose[k] * pose[k];
  }
  return std::fabs(norm - 1.0) < 1e-6;
}

Status CheckStart(const WindowStart& start) {
  const WindowState& state = start.state;
  if (!std::isfinite(state.time) || !IsFinite(state.pose) || !IsFinite(state.velocity) ||
      !IsFinite(state.gyr_bias) || !IsFinite(state.acc_bias)) {
    return Invalid(state.time, "the state at the start is not finite");
  }
  if (!HasUnitQuaternion(state.pose)) {
    return Invalid(state.time, "the quaternion at the start is not of unit length");
  }
  if (!AllPositive(start.pose_sigma) || !AllPositive(start.velocity_sigma) ||
      !AllPositive(start.gyr_bias_sigma) || !AllPositive(start.acc_bias_sigma)) {
    return Invalid(state.time, "a standard deviation of the start is not positive and finite");
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
      return Invalid(time,
                     "the observation of track " + std::to_string(seen.track) + " is not finite");
    }
    tracks.push_back(seen.track);
  }
  // Sorted to find duplicates in O(n log n) and to name the smallest, whatever the order of the
  // input.
  std::sort(tracks.begin(), tracks.end());
  const auto twice = std::adjacent_find(tracks.begin(), tracks.end());
  return twice == tracks.end()
             ? Status::Ok()
             : Invalid(time, "track " + std::to_string(*twice) + " is observed twice");
}

// Time before samples, samples before observations; whether observations belong to known tracks
// does not matter, for a track may begin in any frame.
Status CheckFrame(double last_time, const WindowFrame& frame) {
  if (!std::isfinite(frame.time)) {
    return Invalid(frame.time, "its time is not finite");
  }
  if (!(frame.time > last_time)) {
    return Invalid(frame.time, "does not come after the last one, at " + Text(last_time) + " s");
  }
  const Status status = CheckSamples(frame.time, frame.imu);
  return status.ok() ? CheckObservations(frame.time, frame.observations) : status;
}

}  // namespace inceres::internal
