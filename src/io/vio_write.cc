#include <memory>

#include "inceres/io/vio_sequence.h"
#include "io/byte_stream.h"
#include "io/text_writer.h"

// Writes visual-inertial sequences, in the order of arrival: header, then for each frame the
// samples that lead to it, the frame, the points that it is the first to see, and its observations.
// A reader that follows the file never meets a name that it does not know. Numbers are written so
// that reading gives the same sequence to the last bit.

namespace inceres {
namespace internal {
namespace {

// The format explains itself: lines that start with # are skipped.
constexpr char kComments[] =
    "# inceres visual-inertial sequence: one record a line, in the order of arrival\n"
    "# CAMERA width height  f_x f_y c_x c_y  k1 k2 p1 p2  p_bc(3) q_bc(4)   pinhole, "
    "radial-tangential distortion; "
    "imu_from_camera\n"
    "# NOISE pixel  gyr acc gyr_bias_walk acc_bias_walk   standard deviation in pixels; densities "
    "of the IMU\n"
    "# GRAVITY g(3)                      acceleration of free fall in the world, m/s^2\n"
    "# POINT k  start(3)  truth(3)       meters in the world: initial guess and truth\n"
    "# IMU t  gyr(3)  acc(3)             s, rad/s, m/s^2: rate + bias + noise, R^T (acceleration - "
    "g) + bias + noise\n"
    "# FRAME i t  start(16)  truth(16)   p(3) q(x y z w) v(3) b_g(3) b_a(3): of the IMU in the "
    "world; the samples above lead to "
    "it\n"
    "# OBS k x y outlier                 the frame above sees point k at (x, y) pixels; outlier: 1 "
    "if known to be wrong\n";

// Requires a sequence that Validate()s.
class VioWriter {
 public:
  explicit VioWriter(ByteSink* sink) : writer_(sink) {}

  Status Write(const VioSequence& sequence) {
    // Before the version, which is the first record: comments are none.
    writer_.PutText(kComments);
    PutHeader(sequence);
    std::size_t num_points = 0;
    for (std::size_t i = 0; i < sequence.frames.size(); ++i) {
      const VioFrame& frame = sequence.frames[i];
      // The first sample of all frames but the first is the last one of the frame before.
      for (std::size_t k = i > 0 ? 1 : 0; k < frame.imu.size(); ++k) {
        PutSample(frame.imu[k]);
      }
      PutFrame(static_cast<int>(i), frame);
      // Points are written in the order of their numbers up to the highest one seen, which is the
      // last since observations ascend: some may stand earlier than they must.
      const std::size_t needed =
          frame.observations.empty()
              ? 0
              : static_cast<std::size_t>(frame.observations.back().point) + 1;
      PutPoints(sequence, &num_points, needed);
      // Below the frame that they are seen from, and below the points that they name.
      for (const VioObservation& observation : frame.observations) {
        Put("OBS ", observation.point);
        writer_.Put(observation.x, ' ');
        writer_.Put(observation.y, ' ');
        writer_.Put(observation.outlier ? 1 : 0, '\n');
      }
    }
    // Those that nothing sees.
    PutPoints(sequence, &num_points, sequence.points.size());
    // The writer has kept its first error.
    return writer_.Finish();
  }

 private:
  template <typename Number>
  // A tag and its first field.
  void Put(const char* tag, Number value) {
    writer_.PutText(tag);
    writer_.Put(value, ' ');
  }

  template <typename Values>
  // Arrays of both kinds; the last value is told by its address.
  void PutAll(const Values& values, char end = ' ') {
    for (const double& value : values) {
      writer_.Put(value, &value + 1 == std::end(values) ? end : ' ');
    }
  }

  void PutHeader(const VioSequence& sequence) {
    writer_.PutText("VIO 1\n");
    Put("CAMERA ", sequence.camera.width);
    writer_.Put(sequence.camera.height, ' ');
    PutAll(sequence.camera.intrinsics);
    PutAll(sequence.camera.distortion);
    PutAll(sequence.camera.imu_from_camera, '\n');
    const ImuNoise& noise = sequence.imu_noise;
    Put("NOISE ", sequence.pixel_noise);
    // ImuNoise in the order of the file.
    const double densities[] = {noise.gyr, noise.acc, noise.gyr_bias_walk, noise.acc_bias_walk};
    PutAll(densities, '\n');
    writer_.PutText("GRAVITY ");
    PutAll(sequence.gravity, '\n');
  }

  // t gyr acc, in the units of the sample.
  void PutSample(const ImuSample& sample) {
    Put("IMU ", sample.time);
    PutAll(sample.gyr);
    PutAll(sample.acc, '\n');
  }

  void PutFrame(int number, const VioFrame& frame) {
    Put("FRAME ", number);
    writer_.Put(frame.time, ' ');
    PutState(frame.start, ' ');
    PutState(frame.truth, '\n');
  }

  // p q v b_g b_a, 16 numbers.
  void PutState(const VioState& state, char end) {
    PutAll(state.pose);
    PutAll(state.velocity);
    PutAll(state.gyr_bias);
    PutAll(state.acc_bias, end);
  }

  // From `num_points` on, how many have been written, up to `needed`.
  void PutPoints(const VioSequence& sequence, std::size_t* num_points, std::size_t needed) {
    for (; *num_points < needed; ++*num_points) {
      const VioPoint& point = sequence.points[*num_points];
      Put("POINT ", *num_points);
      PutAll(point.start);
      PutAll(point.truth, '\n');
    }
  }

  TextWriter writer_;
};

}  // namespace
}  // namespace internal

Status WriteVioSequence(const std::string& path, const VioSequence& sequence) {
  if (Status status = sequence.Validate(); !status.ok()) {
    return status;
  }
  // Nothing is opened for a sequence that is not valid: an existing file of that name stays.
  std::unique_ptr<internal::ByteSink> sink;
  if (Status status = internal::OpenByteSink(path, &sink); !status.ok()) {
    return status;
  }
  return internal::VioWriter(sink.get()).Write(sequence);
}

}  // namespace inceres
