#include "inceres/io/keyframes.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <unordered_map>
#include <utility>

#include "inceres/factors/pose_prior.h"
#include "inceres/problem/rotation.h"
#include "io/byte_source.h"
#include "io/read_file.h"
#include "io/record_reader.h"
#include "io/text_scanner.h"

// The reader of keyframe sequences (docs/file_formats.md, "Keyframes"). The file is a record of
// what a visual odometry has told its back-end, in the order of arrival, and is held to that: a
// record may name only keyframes and features that have arrived, and what belongs to a keyframe
// stands below it. A replay can then hand over keyframe after keyframe and never needs what comes
// later.
//
// Features are numbered through the file; the file names them by anchor and number there.

namespace inceres {
namespace internal {
namespace {

// Fields are read in the order of the line, and each is checked before the next one is read, so
// that a message names the first that is wrong.
class KeyframeReader : private RecordReader {
 public:
  KeyframeReader(const std::string& path, std::unique_ptr<ByteSource> source)
      : RecordReader(path, std::move(source)) {}

  // Into a sequence of ReadFile's, which is thrown away after a failure.
  Status Read(KeyframeSequence* sequence) {
    sequence_ = sequence;
    if (Status status = ForEachTaggedLine(&scanner_, &tag_, [this] { return ReadRecord(); });
        !status.ok()) {
      return status;
    }
    return sequence_->keyframes.empty()
               ? scanner_.FailureAt(scanner_.line(), "the file has no keyframes")
               : Status::Ok();
  }

 private:
  Status ReadRecord() {
    if (tag_ == "KEYFRAME") {
      return ReadKeyframe();
    }
    // The tag before the place: an unknown one is told as such wherever it stands.
    if (tag_ != "DEPTH_GUESS" && tag_ != "FEATURE" && tag_ != "OBS" && tag_ != "BETWEEN") {
      return Fail("tag", "not known; known are KEYFRAME, DEPTH_GUESS, FEATURE, OBS and BETWEEN");
    }
    // Everything but a keyframe belongs to the one above it.
    if (sequence_->keyframes.empty()) {
      return Fail("tag", "before the first KEYFRAME");
    }
    return tag_ == "DEPTH_GUESS" ? ReadDepthGuess()
           : tag_ == "FEATURE"   ? ReadFeature()
           : tag_ == "OBS"       ? ReadObservation()
                                 : ReadBetween();
  }

  // Numbered without gaps: the number is the index.
  Status ReadKeyframe() {
    int number = 0;
    if (Status status = ReadIndex("i", &number); !status.ok()) {
      return status;
    }
    if (number != NumKeyframes()) {
      return Fail("i", "keyframe " + std::to_string(number) + " where " +
                           std::to_string(NumKeyframes()) + " comes next");
    }
    Keyframe keyframe;
    // R of the file turns the world into the camera (x_c = R (x_w − p)); the pose is kept as the
    // family has it, world_from_camera, with p the center in both.
    double q_cw[4];
    if (Status status = ReadRotation(q_cw); !status.ok()) {
      return status;
    }
    // The file has camera_from_world; its inverse is the conjugate.
    keyframe.pose = {0.0, 0.0, 0.0, -q_cw[0], -q_cw[1], -q_cw[2], q_cw[3]};
    if (Status status = ReadNumbers("p", 3, keyframe.pose.data()); !status.ok()) {
      return status;
    }
    sequence_->keyframes.push_back(std::move(keyframe));
    return Status::Ok();
  }

  // For any feature that has arrived, not only for those of the current keyframe: an odometry
  // corrects its guesses.
  Status ReadDepthGuess() {
    KeyframeDepthGuess guess;
    int anchor = 0;
    if (Status status = ReadKeyframeNumber("i", &anchor); !status.ok()) {
      return status;
    }
    if (Status status = ReadFeatureOf(anchor, &guess.feature); !status.ok()) {
      return status;
    }
    if (Status status = ReadNumbers("d", 1, &guess.inverse_depth); !status.ok()) {
      return status;
    }
    // 0 would say "not measured", which a guess need not say.
    if (!(guess.inverse_depth > 0.0)) {
      return Fail("d", "not positive");
    }
    current().depth_guesses.push_back(guess);
    return Status::Ok();
  }

  Status ReadFeature() {
    KeyframeFeature feature;
    if (Status status = ReadCurrentKeyframe(); !status.ok()) {
      return status;
    }
    // The line names the keyframe above it, as has been checked.
    feature.anchor = NumKeyframes() - 1;
    if (Status status = ReadIndex("k", &feature.index); !status.ok()) {
      return status;
    }
    const int position = static_cast<int>(sequence_->features.size());
    // Before the rest of the line is read: an error ends the file anyway.
    if (!feature_of_key_.emplace(Key(feature.anchor, feature.index), position).second) {
      return Fail("k", "feature " + std::to_string(feature.index) + " is twice in keyframe " +
                           std::to_string(feature.anchor));
    }
    if (Status status = ReadImagePoint(&feature.x, &feature.y, &feature.inverse_depth);
        !status.ok()) {
      return status;
    }
    // Both lists grow only when the whole line is good.
    current().features.push_back(position);
    sequence_->features.push_back(feature);
    return Status::Ok();
  }

  Status ReadObservation() {
    KeyframeObservation observation;
    int anchor = 0;
    if (Status status = ReadCurrentKeyframe(); !status.ok()) {
      return status;
    }
    if (Status status = ReadKeyframeNumber("a", &anchor); !status.ok()) {
      return status;
    }
    // The residual needs two poses: seen from its anchor, a feature is where it is by definition.
    if (anchor == NumKeyframes() - 1) {
      return Fail("a", "the observing keyframe itself");
    }
    // By anchor and number there, as in the line.
    if (Status status = ReadFeatureOf(anchor, &observation.feature); !status.ok()) {
      return status;
    }
    if (Status status = ReadImagePoint(&observation.x, &observation.y, &observation.inverse_depth);
        !status.ok()) {
      return status;
    }
    double* const w = observation.information.data();
    if (Status status = ReadFields({{"w00", 1, w}, {"w01", 1, w + 1}, {"w11", 1, w + 2}});
        !status.ok()) {
      return status;
    }
    // The file has the upper triangle; SqrtInformation takes the full matrix.
    const std::array<double, 3>& v = observation.information;
    const double matrix[4] = {v[0], v[1], v[1], v[2]};
    // Factored here and again when it becomes a factor, so that the line can be named.
    double ignored[4];
    if (!SqrtInformation(matrix, 2, ignored)) {
      return Fail("w", "not positive definite");
    }
    current().observations.push_back(observation);
    return Status::Ok();
  }

  // Odometry and loops alike. A loop arrives with the keyframe above it, which need not be one of
  // its two.
  Status ReadBetween() {
    KeyframeBetween between;
    if (Status status = ReadKeyframeNumber("a", &between.a); !status.ok()) {
      return status;
    }
    if (Status status = ReadKeyframeNumber("b", &between.b); !status.ok()) {
      return status;
    }
    // Such a factor would have one variable in both of its slots.
    if (between.a == between.b) {
      return Fail("b", "keyframe " + std::to_string(between.b) + " with itself");
    }
    if (Status status = ReadRotation(between.q_ab.data()); !status.ok()) {
      return status;
    }
    // All of the matrix, unlike that of an observation: so its symmetry can be checked, and is.
    if (Status status =
            ReadFields({{"p", 3, between.p_ab.data()}, {"w", 36, between.information.data()}});
        !status.ok()) {
      return status;
    }
    if (Status status = CheckInformation(between.information); !status.ok()) {
      return status;
    }
    current().betweens.push_back(between);
    return Status::Ok();
  }

  // Symmetric up to the digits that files print, measured by the diagonal. SqrtInformation reads
  // the upper triangle only and would not notice.
  Status CheckInformation(const std::array<double, 36>& w) const {
    for (std::size_t r = 0; r < 6; ++r) {
      for (std::size_t c = 0; c < r; ++c) {
        // The bound √(w_rr w_cc) is the size that an entry can have at most in a definite matrix:
        // 1e-5 of it, in any units of rotation and position.
        if (std::fabs(w[6 * r + c] - w[6 * c + r]) >
            1e-5 * std::sqrt(std::fabs(w[7 * r] * w[7 * c]))) {
          return Fail("w",
                      "not symmetric: row " + std::to_string(r) + ", column " + std::to_string(c));
        }
      }
    }
    double ignored[36];
    return SqrtInformation(w.data(), 6, ignored) ? Status::Ok()
                                                 : Fail("w", "not positive definite");
  }

  // Of any keyframe that has arrived, the current one included.
  Status ReadKeyframeNumber(const char* field, int* number) {
    if (Status status = ReadIndex(field, number); !status.ok()) {
      return status;
    }
    return *number < NumKeyframes()
               ? Status::Ok()
               : Fail(field, "keyframe " + std::to_string(*number) + " has not arrived yet");
  }

  // FEATURE and OBS repeat the number of their keyframe, which must be the one above.
  Status ReadCurrentKeyframe() {
    int number = 0;
    if (Status status = ReadIndex("i", &number); !status.ok()) {
      return status;
    }
    const int expected = NumKeyframes() - 1;
    return number == expected ? Status::Ok()
                              : Fail("i", std::to_string(number) + " is not the keyframe above, " +
                                              std::to_string(expected));
  }

  // By its key; `feature` is the index in the sequence.
  Status ReadFeatureOf(int anchor, int* feature) {
    int index = 0;
    if (Status status = ReadIndex("k", &index); !status.ok()) {
      return status;
    }
    const auto found = feature_of_key_.find(Key(anchor, index));
    if (found == feature_of_key_.end()) {
      return Fail(
          "k", "keyframe " + std::to_string(anchor) + " has no feature " + std::to_string(index));
    }
    *feature = found->second;
    return Status::Ok();
  }

  Status ReadImagePoint(double* x, double* y, double* inverse_depth) {
    if (Status status = ReadFields({{"x", 1, x}, {"y", 1, y}, {"d_obs", 1, inverse_depth}});
        !status.ok()) {
      return status;
    }
    // Written so that 0, which says that it was not measured, passes.
    return *inverse_depth >= 0.0 ? Status::Ok() : Fail("d_obs", "negative");
  }

  // MatrixToQuaternion takes any matrix and is exact for rotations only; back as a matrix, the
  // quaternion shows how far the nine numbers were from one. 1e-4 leaves room for files of few
  // digits.
  Status ReadRotation(double q[4]) {
    double R[9];
    if (Status status = ReadNumbers("R", 9, R); !status.ok()) {
      return status;
    }
    MatrixToQuaternion(R, q);
    double nearest[9];
    QuaternionToMatrix(q, nearest);
    for (int k = 0; k < 9; ++k) {
      // In this form a NaN is refused too.
      if (!(std::fabs(R[k] - nearest[k]) < 1e-4)) {
        return Fail("R", "not a rotation matrix");
      }
    }
    return Status::Ok();
  }

  int NumKeyframes() const { return static_cast<int>(sequence_->keyframes.size()); }
  Keyframe& current() { return sequence_->keyframes.back(); }
  // Both are ints from 0 on: one in each half.
  static std::int64_t Key(int anchor, int index) {
    return (static_cast<std::int64_t>(anchor) << 32) | index;
  }

  KeyframeSequence* sequence_ = nullptr;
  // Only looked up in, never walked through: its order has no part in the result.
  std::unordered_map<std::int64_t, int> feature_of_key_;
};

}  // namespace
}  // namespace internal

int KeyframeSequence::NumObservations() const {
  std::size_t count = 0;
  for (const Keyframe& keyframe : keyframes) {
    count += keyframe.observations.size();
  }
  return static_cast<int>(count);
}

int KeyframeSequence::NumBetweens() const {
  std::size_t count = 0;
  for (const Keyframe& keyframe : keyframes) {
    count += keyframe.betweens.size();
  }
  return static_cast<int>(count);
}

Status ReadKeyframes(const std::string& path, KeyframeSequence* sequence,
                     const ReadOptions& options) {
  return internal::ReadFile<internal::KeyframeReader>(path, sequence, options);
}

}  // namespace inceres
