#include <string>
#include <utility>

#include "inceres/io/vio_sequence.h"
#include "io/record_reader.h"
#include "io/vio_checks.h"

// The reader of visual-inertial sequences (docs/visual_inertial.md, "Simulated sequences"). The
// file is in the order of arrival, and the reader insists on it: what it accepts,
// VioSequence::Validate accepts too, but here with the line at hand.
//
// IMU samples gather in samples_ until a frame takes them. The sample at the time of a frame
// belongs to two stretches, as the last of one and the first of the next: it stands in the file
// once and is kept when the frame has been read, so that each stretch is ready to be integrated
// from frame to frame.

namespace inceres {
namespace internal {
namespace {

class VioReader : private RecordReader {
 public:
  using RecordReader::RecordReader;

  Status Read(VioSequence* sequence) {
    sequence_ = sequence;
    if (ForEachTaggedLine([this] { return ReadRecord(); })) {
      // One is left from the last frame; more than that belong to a frame that never comes.
      if (sequence_->frames.empty()) {
        FailAt(scanner_.line(), "the file has no frames");
      } else if (samples_.size() > 1) {
        FailAt(scanner_.line(), "IMU samples after the last frame");
      }
    }
    return status_;
  }

 private:
  bool ReadRecord() {
    // Before anything else: the records of another version may mean something else.
    if (!versioned_) {
      return ReadVersion();
    }
    // Readers by tag. The table is searched anew for each line: seven short comparisons.
    const struct {
      const char* tag;
      // A member function, which reads the fields behind the tag.
      bool (VioReader::*read)();
      bool* seen;  // of what stands in the header, once
    } kinds[] = {{"CAMERA", &VioReader::ReadCamera, &has_camera_},
                 {"NOISE", &VioReader::ReadNoise, &has_noise_},
                 {"GRAVITY", &VioReader::ReadGravity, &has_gravity_},
                 {"POINT", &VioReader::ReadPoint, nullptr},
                 {"IMU", &VioReader::ReadSample, nullptr},
                 {"FRAME", &VioReader::ReadFrame, nullptr},
                 {"OBS", &VioReader::ReadObservation, nullptr}};
    for (const auto& kind : kinds) {
      if (tag_ != kind.tag) {
        continue;
      }
      // What stands in the header holds for the whole file and may be given once.
      if (kind.seen != nullptr && std::exchange(*kind.seen, true)) {
        return Fail("tag", "in the file twice");
      }
      return (this->*kind.read)();
    }
    return Fail("tag", "not known; known are CAMERA, NOISE, GRAVITY, POINT, IMU, FRAME and OBS");
  }

  bool ReadVersion() {
    if (tag_ != "VIO") {
      return Fail("tag", "where the file should begin with VIO 1");
    }
    int version = 0;
    if (!ReadIndex("version", &version)) {
      return false;
    }
    versioned_ = true;
    return version == 1 || Fail("version", std::to_string(version) + " is not known, only 1");
  }

  // Into the sequence at once, then checked: after a failure nobody sees it.
  bool ReadCamera() {
    VioCamera& camera = sequence_->camera;
    return ReadIndex("width", &camera.width) && ReadIndex("height", &camera.height) &&
           ReadFields({{"intrinsics", 4, camera.intrinsics.data()},
                       {"distortion", 4, camera.distortion.data()},
                       {"p_bc", 3, camera.imu_from_camera.data()},
                       {"q_bc", 4, camera.imu_from_camera.data() + 3}}) &&
           IsNone(FaultOf(camera));
  }

  // The deviation of pixels, then the four densities of ImuNoise.
  bool ReadNoise() {
    ImuNoise& noise = sequence_->imu_noise;
    return ReadFields({{"pixel", 1, &sequence_->pixel_noise},
                       {"gyr", 1, &noise.gyr},
                       {"acc", 1, &noise.acc},
                       {"gyr_bias_walk", 1, &noise.gyr_bias_walk},
                       {"acc_bias_walk", 1, &noise.acc_bias_walk}}) &&
           IsNone(FaultOf(sequence_->pixel_noise, noise));
  }

  // Any finite vector: zero is a world without weight.
  bool ReadGravity() { return ReadNumbers("g", 3, sequence_->gravity.data()); }

  // Anywhere in the file, before the first observation of it.
  bool ReadPoint() {
    if (!ReadNumber("k", sequence_->points.size())) {
      return false;
    }
    // Start and truth stand side by side: an estimator takes the one, whoever judges it the other.
    VioPoint& point = sequence_->points.emplace_back();
    return ReadFields({{"start", 3, point.start.data()}, {"truth", 3, point.truth.data()}});
  }

  bool ReadSample() {
    // Camera, noise and gravity have to stand before the samples, so whoever reads along knows them
    // from the first measurement on.
    if (!has_camera_ || !has_noise_ || !has_gravity_) {
      return Fail("tag", std::string("before ") + (!has_camera_  ? "CAMERA"
                                                   : !has_noise_ ? "NOISE"
                                                                 : "GRAVITY"));
    }
    // t, then rates and forces, each three. After a failure nobody sees the sample.
    ImuSample sample;
    if (!ReadNumbers("t", 1, &sample.time)) {
      return false;
    }
    // The last frame's sample is among samples_: times increase through the whole file, and never
    // by zero.
    if (!samples_.empty() && !(sample.time > samples_.back().time)) {
      return Fail("t", std::to_string(sample.time) + " is not after the sample's before, " +
                           std::to_string(samples_.back().time));
    }
    const bool read = ReadFields({{"gyr", 3, sample.gyr}, {"acc", 3, sample.acc}});
    samples_.push_back(sample);
    return read;
  }

  bool ReadFrame() {
    VioFrame frame;
    if (!ReadNumber("i", sequence_->frames.size()) || !ReadNumbers("t", 1, &frame.time)) {
      return false;
    }
    // At least one sample after the last frame's: a stretch of one sample has no duration.
    const bool stands_still = !sequence_->frames.empty() && samples_.size() < 2;
    // Equal to the bit: times are printed in the shortest form that reads back as the same double.
    if (samples_.empty() || stands_still || samples_.back().time != frame.time) {
      return Fail("t", "the last IMU sample above is not one at the time of this frame, " +
                           std::to_string(frame.time));
    }
    // Values are the same 16 numbers twice, told apart in messages by the word before.
    if (!ReadState("start", &frame.start) || !ReadState("truth", &frame.truth)) {
      return false;
    }
    // The argument is made before the exchange: the next stretch begins with this one's last
    // sample.
    frame.imu = std::exchange(samples_, {samples_.back()});
    sequence_->frames.push_back(std::move(frame));
    return true;
  }

  // 16 numbers, "start" or "truth".
  bool ReadState(const std::string& name, VioState* state) {
    if (!ReadFields({{name + " p", 3, state->pose.data()},
                     {name + " q", 4, state->pose.data() + 3},
                     {name + " v", 3, state->velocity.data()},
                     {name + " b_g", 3, state->gyr_bias.data()},
                     {name + " b_a", 3, state->acc_bias.data()}})) {
      return false;
    }
    // Refused, where the reader of g2o files normalizes: this format prints all digits, and what is
    // read is what was written, to the bit.
    return IsUnitQuaternion(state->pose.data() + 3) || Fail(name + " q", "not a unit quaternion");
  }

  bool ReadObservation() {
    if (sequence_->frames.empty()) {
      return Fail("tag", "before the first FRAME");
    }
    // Those of the frame above, whose observations end where the next FRAME begins.
    std::vector<VioObservation>& observations = sequence_->frames.back().observations;
    VioObservation observation;
    if (!ReadIndex("k", &observation.point)) {
      return false;
    }
    // Not an index into what will be: the POINT has to stand above.
    if (observation.point >= static_cast<int>(sequence_->points.size())) {
      return Fail("k", "point " + std::to_string(observation.point) + " has not arrived yet");
    }
    // Ascending, so that a point seen twice is found by its neighbor alone.
    if (!observations.empty() && observation.point <= observations.back().point) {
      return Fail("k", "point " + std::to_string(observation.point) + " after point " +
                           std::to_string(observations.back().point) +
                           "; a frame sees points once, in ascending order");
    }
    // Pixels, which may lie outside of the image: only the estimator knows whether to mind. Then
    // what the simulator knows and no estimator is told.
    int outlier = 0;
    if (!ReadFields({{"x", 1, &observation.x}, {"y", 1, &observation.y}}) ||
        !ReadIndex("outlier", &outlier)) {
      return false;
    }
    // ReadIndex has refused what is negative.
    if (outlier > 1) {
      return Fail("outlier", std::to_string(outlier) + " is neither 0 nor 1");
    }
    observation.outlier = outlier == 1;
    observations.push_back(observation);
    return true;
  }

  // The number of a record that is counted from 0.
  bool ReadNumber(const char* field, std::size_t next) {
    int number = 0;
    return ReadIndex(field, &number) &&
           (static_cast<std::size_t>(number) == next ||
            Fail(field, std::to_string(number) + " where " + std::to_string(next) + " comes next"));
  }

  // Fault: "field: what", or empty.
  bool IsNone(const std::string& fault) {
    return fault.empty() || FailAt(scanner_.line(), Named(fault));
  }

  VioSequence* sequence_ = nullptr;
  bool versioned_ = false, has_camera_ = false, has_noise_ = false, has_gravity_ = false;
  std::vector<ImuSample> samples_;  // since the last frame, its own sample first
};

}  // namespace
}  // namespace internal

Status ReadVioSequence(const std::string& path, VioSequence* sequence, const ReadOptions& options) {
  return internal::ReadFile<internal::VioReader>(path, sequence, options);
}

}  // namespace inceres
