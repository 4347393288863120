#include "inceres/io/vio_sequence.h"

#include <algorithm>
#include <cmath>

#include "inceres/problem/rotation.h"
#include "io/vio_checks.h"

// What a visual-inertial sequence promises (inceres/io/vio_sequence.h), checked for sequences that
// a program has made; the reader of files checks the same line by line. And the camera's
// projection, by which the simulator makes its observations: io is compiled without fused
// multiply-adds (src/io/CMakeLists.txt), so that a seed gives the same bits on every platform.

namespace inceres {
namespace internal {

// What a camera and the noise of a sequence must fulfill, said once for the reader, for
// VioSequence::Validate and for the simulator. Each puts its own words in front of "field: what is
// wrong"; comparisons are written so that a NaN fails.

// Sizes first, then that all is finite, then the focal lengths: an image of no size needs no
// further look. Distortion may be anything finite.
std::string FaultOf(const VioCamera& camera) {
  if (camera.width < 1 || camera.height < 1) {
    return std::string(camera.width < 1 ? "width" : "height") + ": not positive";
  }
  if (!AllFinite(camera.intrinsics) || !AllFinite(camera.distortion) ||
      !AllFinite(camera.imu_from_camera)) {
    return "intrinsics, distortion or imu_from_camera: not finite";
  }
  if (!(camera.intrinsics[0] > 0.0 && camera.intrinsics[1] > 0.0)) {
    return std::string(camera.intrinsics[0] > 0.0 ? "f_y" : "f_x") + ": not positive";
  }
  return IsUnitQuaternion(camera.imu_from_camera.data() + 3) ? "" : "q_bc: not a unit quaternion";
}

// An information is the inverse of a variance: no deviation may be 0.
std::string FaultOf(double pixel_noise, const ImuNoise& noise) {
  const struct {
    const char* name;
    double value;
  } fields[] = {{"pixel", pixel_noise},
                {"gyr", noise.gyr},
                {"acc", noise.acc},
                {"gyr_bias_walk", noise.gyr_bias_walk},
                {"acc_bias_walk", noise.acc_bias_walk}};
  for (const auto& field : fields) {
    if (!(field.value > 0.0 && std::isfinite(field.value))) {
      return std::string(field.name) + ": not positive";
    }
  }
  return "";
}

}  // namespace internal

namespace {

Status Invalid(const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, "VioSequence: " + what);
}

bool IsFinite(const ImuSample& sample) {
  return std::isfinite(sample.time) && internal::AllFinite(sample.gyr) &&
         internal::AllFinite(sample.acc);
}

bool IsSame(const ImuSample& a, const ImuSample& b) {
  return a.time == b.time && std::equal(a.gyr, a.gyr + 3, b.gyr) &&
         std::equal(a.acc, a.acc + 3, b.acc);
}

bool IsGood(const VioState& state) {
  return internal::AllFinite(state.pose) && internal::AllFinite(state.velocity) &&
         internal::AllFinite(state.gyr_bias) && internal::AllFinite(state.acc_bias) &&
         internal::IsUnitQuaternion(state.pose.data() + 3);
}

Status CheckHeader(const VioSequence& sequence) {
  // FaultOf begins with the field: "camera.f_x: not positive".
  if (std::string fault = internal::FaultOf(sequence.camera); !fault.empty()) {
    return Invalid("camera." + fault);
  }
  if (std::string fault = internal::FaultOf(sequence.pixel_noise, sequence.imu_noise);
      !fault.empty()) {
    return Invalid("noise: " + fault);
  }
  return internal::AllFinite(sequence.gravity) ? Status::Ok() : Invalid("gravity is not finite");
}

// The stretch that leads to a frame: not empty, its times increasing, its last sample at the time
// of the frame, and its first one the last of the frame before.
Status CheckImu(const VioSequence& sequence, std::size_t i) {
  const VioFrame& frame = sequence.frames[i];
  const std::string name = "frames[" + std::to_string(i) + "].imu";
  if (frame.imu.empty() || frame.imu.back().time != frame.time) {
    return Invalid(name + " has no sample at the time of the frame");
  }
  for (std::size_t k = 0; k < frame.imu.size(); ++k) {
    const ImuSample& sample = frame.imu[k];
    if (!IsFinite(sample)) {
      return Invalid(name + "[" + std::to_string(k) + "] is not finite");
    }
    // Finite already, so that the comparison means what it says.
    if (k > 0 && !(sample.time > frame.imu[k - 1].time)) {
      return Invalid(name + "[" + std::to_string(k) + "].time is not after the sample's before");
    }
  }
  // All seven numbers of the shared sample and not its time alone: written to a file it stands
  // there once. Requires that frame i − 1 has been checked, and so has a sample.
  if (i > 0 &&
      !(frame.imu.size() > 1 && IsSame(frame.imu.front(), sequence.frames[i - 1].imu.back()))) {
    return Invalid(name + " does not go on from the last sample of the frame before");
  }
  return Status::Ok();
}

Status CheckFrame(const VioSequence& sequence, std::size_t i) {
  const VioFrame& frame = sequence.frames[i];
  const std::string name = "frames[" + std::to_string(i) + "]";
  for (const VioState* state : {&frame.start, &frame.truth}) {
    if (!IsGood(*state)) {
      return Invalid(name + (state == &frame.start ? ".start" : ".truth") +
                     " is not finite, or its q no unit quaternion");
    }
  }
  if (Status status = CheckImu(sequence, i); !status.ok()) {
    return status;
  }
  // Ascending and in range at once; −1 is below every index.
  int last = -1;
  for (const VioObservation& observation : frame.observations) {
    if (observation.point <= last ||
        observation.point >= static_cast<int>(sequence.points.size())) {
      return Invalid(name + ".observations: point " + std::to_string(observation.point) +
                     " is not there, or out of order, or seen twice");
    }
    last = observation.point;
    if (!std::isfinite(observation.x) || !std::isfinite(observation.y)) {
      return Invalid(name + ".observations: point " + std::to_string(last) +
                     " is seen where it is not finite");
    }
  }
  return Status::Ok();
}

}  // namespace

int VioSequence::NumObservations() const {
  std::size_t count = 0;
  for (const VioFrame& frame : frames) {
    count += frame.observations.size();
  }
  return static_cast<int>(count);
}

int VioSequence::NumOutliers() const {
  std::ptrdiff_t count = 0;
  for (const VioFrame& frame : frames) {
    count += std::count_if(frame.observations.begin(), frame.observations.end(),
                           [](const auto& o) { return o.outlier; });
  }
  return static_cast<int>(count);
}

// x_c = R_bcᵀ (R_wbᵀ (x_w − p_wb) − p_bc), then pinhole and distortion.
bool VioSequence::Project(const std::array<double, 7>& pose, const std::array<double, 3>& point,
                          double* x, double* y) const {
  // In the world, then in the IMU, then in the camera; x ↦ Rᵀ (x − p) each time.
  double place[3] = {point[0], point[1], point[2]};
  for (const double* frame :
       {pose.data(), camera.imu_from_camera.data()}) {  // world to IMU, IMU to camera
    // The transpose, by the conjugate.
    double q[4], R[9];
    ConjugateQuaternion(frame + 3, q);
    QuaternionToMatrix(q, R);
    const double from_origin[3] = {place[0] - frame[0], place[1] - frame[1], place[2] - frame[2]};
    MultiplyMatrixVector(R, from_origin, place);
  }
  // Nor is what the formula yields behind the camera an observation.
  if (!(place[2] > 0.0)) {
    return false;
  }
  // On the plane z = 1, whose coordinates the distortion is a polynomial of. No matter whether the
  // pixel is inside of the image: callers know its size.
  double pixel[2];
  camera.Pinhole().Project(place[0] / place[2], place[1] / place[2], pixel);
  *x = pixel[0];
  *y = pixel[1];
  return true;
}

// Frames in order: each is held against the one before.
Status VioSequence::Validate() const {
  if (Status status = CheckHeader(*this); !status.ok()) {
    return status;
  }
  // Points may be missing altogether: a sequence may be one of the IMU alone.
  if (frames.empty()) {
    return Invalid("no frames");
  }
  // Before the frames, whose observations are held against their number.
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (!internal::AllFinite(points[k].start) || !internal::AllFinite(points[k].truth)) {
      return Invalid("points[" + std::to_string(k) + "] is not finite");
    }
  }
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (Status status = CheckFrame(*this, i); !status.ok()) {
      return status;
    }
  }
  return Status::Ok();
}

}  // namespace inceres
