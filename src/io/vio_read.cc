#include <memory>
#include <string>
#include <utility>

#include "inceres/io/vio_sequence.h"
#include "io/byte_source.h"
#include "io/read_file.h"
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
  VioReader(const std::string& path, std::unique_ptr<ByteSource> source)
      : RecordReader(path, std::move(source)) {}

  Status Read(VioSequence* sequence) {
    sequence_ = sequence;
    if (Status status = ForEachTaggedLine(&scanner_, &tag_, [this] { return ReadRecord(); });
        !status.ok()) {
      return status;
    }
    if (sequence_->frames.empty()) {
      return scanner_.FailureAt(scanner_.line(), "the file has no frames");
    }
    // One is left from the last frame; more than that belong to a frame that never comes.
    return samples_.size() > 1
               ? scanner_.FailureAt(scanner_.line(), "IMU samples after the last frame")
               : Status::Ok();
  }

 private:
  Status ReadRecord() {
    // Before anything else: the records of another version may mean something else.
    if (!versioned_) {
      return ReadVersion();
    }
    // Readers by tag. The table is searched anew for each line: seven short comparisons.
    const struct {
      const char* tag;
      // A member function, which reads the fields behind the tag.
      Status (VioReader::*read)();
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

  Status ReadVersion() {
    if (tag_ != "VIO") {
      return Fail("tag", "where the file should begin with VIO 1");
    }
    int version = 0;
    if (Status status = ReadIndex("version", &version); !status.ok()) {
      return status;
    }
    versioned_ = true;
    return version == 1 ? Status::Ok()
                        : Fail("version", std::to_string(version) + " is not known, only 1");
  }

  // Into the sequence at once, then checked: after a failure nobody sees it.
  Status ReadCamera() {
    VioCamera& camera = sequence_->camera;
    if (Status status = ReadIndex("width", &camera.width); !status.ok()) {
      return status;
    }
    if (Status status = ReadIndex("height", &camera.height); !status.ok()) {
      return status;
    }
    Status status = ReadFields({{"intrinsics", 4, camera.intrinsics.data()},
                                {"distortion", 4, camera.distortion.data()},
                                {"p_bc", 3, camera.imu_from_camera.data()},
                                {"q_bc", 4, camera.imu_from_camera.data() + 3}});
    return status.ok() ? FailIf(FaultOf(camera)) : status;
  }

  // The deviation of pixels, then the four densities of ImuNoise.
  Status ReadNoise() {
    ImuNoise& noise = sequence_->imu_noise;
    Status status = ReadFields({{"pixel", 1, &sequence_->pixel_noise},
                                {"gyr", 1, &noise.gyr},
                                {"acc", 1, &noise.acc},
                                {"gyr_bias_walk", 1, &noise.gyr_bias_walk},
                                {"acc_bias_walk", 1, &noise.acc_bias_walk}});
    return status.ok() ? FailIf(FaultOf(sequence_->pixel_noise, noise)) : status;
  }

  // Any finite vector: zero is a world without weight.
  Status ReadGravity() { return ReadNumbers("g", 3, sequence_->gravity.data()); }

  // Anywhere in the file, before the first observation of it.
  Status ReadPoint() {
    if (Status status = ReadNumber("k", sequence_->points.size()); !status.ok()) {
      return status;
    }
    // Start and truth stand side by side: an estimator takes the one, whoever judges it the other.
    VioPoint& point = sequence_->points.emplace_back();
    return ReadFields({{"start", 3, point.start.data()}, {"truth", 3, point.truth.data()}});
  }

  Status ReadSample() {
    // Camera, noise and gravity have to stand before the samples, so whoever reads along knows them
    // from the first measurement on.
    if (!has_camera_ || !has_noise_ || !has_gravity_) {
      return Fail("tag", std::string("before ") + (!has_camera_  ? "CAMERA"
                                                   : !has_noise_ ? "NOISE"
                                                                 : "GRAVITY"));
    }
    // t, then rates and forces, each three. After a failure nobody sees the sample.
    ImuSample sample;
    if (Status status = ReadNumbers("t", 1, &sample.time); !status.ok()) {
      return status;
    }
    // The last frame's sample is among samples_: times increase through the whole file, and never
    // by zero.
    if (!samples_.empty() && !(sample.time > samples_.back().time)) {
      return Fail("t", std::to_string(sample.time) + " is not after the sample's before, " +
                           std::to_string(samples_.back().time));
    }
    Status status = ReadFields({{"gyr", 3, sample.gyr}, {"acc", 3, sample.acc}});
    samples_.push_back(sample);
    return status;
  }

  Status ReadFrame() {
    if (Status status = ReadNumber("i", sequence_->frames.size()); !status.ok()) {
      return status;
    }
    VioFrame frame;
    if (Status status = ReadNumbers("t", 1, &frame.time); !status.ok()) {
      return status;
    }
    // At least one sample after the last frame's: a stretch of one sample has no duration.
    const bool stands_still = !sequence_->frames.empty() && samples_.size() < 2;
    // Equal to the bit: times are printed in the shortest form that reads back as the same double.
    if (samples_.empty() || stands_still || samples_.back().time != frame.time) {
      return Fail("t", "the last IMU sample above is not one at the time of this frame, " +
                           std::to_string(frame.time));
    }
    // Values are the same 16 numbers twice, told apart in messages by the word before.
    if (Status status = ReadState("start", &frame.start); !status.ok()) {
      return status;
    }
    if (Status status = ReadState("truth", &frame.truth); !status.ok()) {
      return status;
    }
    // The argument is made before the exchange: the next stretch begins with this one's last
    // sample.
    frame.imu = std::exchange(samples_, {samples_.back()});
    sequence_->frames.push_back(std::move(frame));
    return Status::Ok();
  }

  // 16 numbers, "start" or "truth".
  Status ReadState(const std::string& name, VioState* state) {
    if (Status status = ReadFields({{name + " p", 3, state->pose.data()},
                                    {name + " q", 4, state->pose.data() + 3},
                                    {name + " v", 3, state->velocity.data()},
                                    {name + " b_g", 3, state->gyr_bias.data()},
                                    {name + " b_a", 3, state->acc_bias.data()}});
        !status.ok()) {
      return status;
    }
    // Refused, where the reader of g2o files normalizes: this format prints all digits, and what is
    // read is what was written, to the bit.
    return IsUnitQuaternion(state->pose.data() + 3) ? Status::Ok()
                                                    : Fail(name + " q", "not a unit quaternion");
  }

  Status ReadObservation() {
    if (sequence_->frames.empty()) {
      return Fail("tag", "before the first FRAME");
    }
    // Those of the frame above, whose observations end where the next FRAME begins.
    std::vector<VioObservation>& observations = sequence_->frames.back().observations;
    VioObservation observation;
    if (Status status = ReadIndex("k", &observation.point); !status.ok()) {
      return status;
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
    // Pixels, which may lie outside of the image: only the estimator knows whether to mind.
    if (Status status = ReadFields({{"x", 1, &observation.x}, {"y", 1, &observation.y}});
        !status.ok()) {
      return status;
    }
    // What the simulator knows and no estimator is told.
    int outlier = 0;
    if (Status status = ReadIndex("outlier", &outlier); !status.ok()) {
      return status;
    }
    // ReadIndex has refused what is negative.
    if (outlier > 1) {
      return Fail("outlier", std::to_string(outlier) + " is neither 0 nor 1");
    }
    observation.outlier = outlier == 1;
    observations.push_back(observation);
    return Status::Ok();
  }

  // The number of a record that is counted from 0.
  Status ReadNumber(const char* field, std::size_t next) {
    int number = 0;
    if (Status status = ReadIndex(field, &number); !status.ok()) {
      return status;
    }
    return static_cast<std::size_t>(number) == next
               ? Status::Ok()
               : Fail(field,
                      std::to_string(number) + " where " + std::to_string(next) + " comes next");
  }

  // Fault: "field: what", or empty.
  Status FailIf(const std::string& fault) const {
    return fault.empty() ? Status::Ok() : scanner_.FailureAt(scanner_.line(), tag_ + ": " + fault);
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
