#include "tools/sim/vio_noise.h"

#include <array>
#include <cmath>

#include "tools/sim/portable_math.h"
#include "tools/sim/random_subset.h"

namespace inceres::internal {
namespace {

// Streams of random numbers; 1 and 2 belong to the tracks.
enum Stream : std::uint64_t {
  kGyrNoise = 3,
  kAccNoise,
  kGyrWalk,
  kAccWalk,
  kPixelNoise,
  kOutliers,
  kPositionDrift,
  kRotationDrift,
  kPointNoise
};

constexpr double kPi = 3.14159265358979323846;
constexpr double kDriftPeriod = 20.0;  // seconds

// One of the two sensors: its bias walks from sample to sample.
class Sensor {
 public:
  Sensor(std::uint64_t seed, Stream noise_stream, Stream walk_stream, double initial_bias)
      : noise_(seed, noise_stream), walk_(seed, walk_stream), bias_(walk_.Normal3(initial_bias)) {}

  /// Turns what is exact into what is measured.
  void Measure(double noise, double* values) {
    const Vector3 white = noise_.Normal3(noise);
    for (std::size_t k = 0; k < 3; ++k) {
      values[k] += bias_[k] + white[k];
    }
  }
  void Walk(double step) { bias_ = bias_ + walk_.Normal3(step); }
  const Vector3& bias() const { return bias_; }

 private:
  Random noise_, walk_;
  Vector3 bias_;
};

// A slow wandering from 0: two sines for each coordinate, of random sizes, with periods of about
// kDriftPeriod.
class Drift {
 public:
  Drift(std::uint64_t seed, Stream stream, double size) {
    Random random(seed, stream);
    for (std::size_t i = 0; i < 2; ++i) {
      amplitudes_[i] = random.Normal3(size);
      for (double& rate : rates_[i]) {
        rate = 2.0 * kPi / kDriftPeriod * random.Uniform(0.5, 1.5);
      }
    }
  }

  void At(double time, Vector3* value, Vector3* derivative) const {
    *value = *derivative = {};
    for (std::size_t i = 0; i < 2; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        (*value)[k] += amplitudes_[i][k] * PortableSin(rates_[i][k] * time);
        (*derivative)[k] += amplitudes_[i][k] * rates_[i][k] * PortableCos(rates_[i][k] * time);
      }
    }
  }

 private:
  std::array<Vector3, 2> amplitudes_{}, rates_{};
};

}  // namespace

void AddImuNoise(const VioSceneOptions& options, VioSequence* sequence) {
  const double root_dt = std::sqrt(1.0 / (options.frame_rate * options.imu_per_frame));
  Sensor gyr(options.seed, kGyrNoise, kGyrWalk, options.initial_gyr_bias);
  Sensor acc(options.seed, kAccNoise, kAccWalk, options.initial_acc_bias);
  const ImuSample* last = nullptr;
  for (VioFrame& frame : sequence->frames) {
    for (ImuSample& sample : frame.imu) {
      if (last != nullptr && &sample == &frame.imu.front()) {
        sample = *last;  // of the frame before
        continue;
      }
      if (last != nullptr) {
        gyr.Walk(options.gyr_bias_walk * root_dt);
        acc.Walk(options.acc_bias_walk * root_dt);
      }
      gyr.Measure(options.gyr_noise / root_dt, sample.gyr);
      acc.Measure(options.acc_noise / root_dt, sample.acc);
      last = &sample;
    }
    frame.truth.gyr_bias = gyr.bias();
    frame.truth.acc_bias = acc.bias();
  }
}

void AddPixelNoise(const VioSceneOptions& options, VioSequence* sequence) {
  std::vector<VioObservation*> observations;
  for (VioFrame& frame : sequence->frames) {
    for (VioObservation& observation : frame.observations) {
      observations.push_back(&observation);
    }
  }
  Random noise(options.seed, kPixelNoise);
  for (VioObservation* observation : observations) {
    observation->x += options.pixel_noise * noise.Normal();
    observation->y += options.pixel_noise * noise.Normal();
  }
  Random random(options.seed, kOutliers);
  ForRandomSubset(options.outlier_fraction, observations.size(), &random, [&](std::size_t i) {
    observations[i]->x += random.Uniform(-options.outlier_pixels, options.outlier_pixels);
    observations[i]->y += random.Uniform(-options.outlier_pixels, options.outlier_pixels);
    observations[i]->outlier = true;
  });
}

void MakeStartValues(const VioSceneOptions& options, VioSequence* sequence) {
  const Drift position(options.seed, kPositionDrift, options.position_drift);
  const Drift rotation(options.seed, kRotationDrift, options.rotation_drift);
  for (VioFrame& frame : sequence->frames) {
    const VioState& truth = frame.truth;
    Vector3 moved, faster, turned, ignored;
    position.At(frame.time, &moved, &faster);
    rotation.At(frame.time, &turned, &ignored);
    const Rotation R = Rotation::FromAngleAxis(turned) *
                       Rotation{truth.pose[6], {truth.pose[3], truth.pose[4], truth.pose[5]}};
    frame.start.pose = {truth.pose[0] + moved[0],
                        truth.pose[1] + moved[1],
                        truth.pose[2] + moved[2],
                        R.v[0],
                        R.v[1],
                        R.v[2],
                        R.w};
    frame.start.velocity = truth.velocity + faster;
  }
  Random random(options.seed, kPointNoise);
  for (VioPoint& point : sequence->points) {
    point.start = point.truth + random.Normal3(options.point_noise);
  }
}

}  // namespace inceres::internal
