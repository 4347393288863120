#include "inceres/io/keyframes.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <utility>

#include "inceres/factors/pose_prior.h"
#include "io/record_reader.h"

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
  using RecordReader::RecordReader;

  // Into a sequence of ReadFile's, which is thrown away after a failure.
  Status Read(KeyframeSequence* sequence) {
    sequence_ = sequence;
    if (ForEachTaggedLine([this] { return ReadRecord(); }) && sequence_->keyframes.empty()) {
      FailAt(scanner_.line(), "the file has no keyframes");
    }
    return status_;
  }

 private:
  bool ReadRecord() {
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
  bool ReadKeyframe() {
    int number = 0;
    if (!ReadIndex("i", &number)) {
      return false;
    }
    if (number != NumKeyframes()) {
      return Fail("i", "keyframe " + std::to_string(number) + " where " +
                           std::to_string(NumKeyframes()) + " comes next");
    }
    Keyframe keyframe;
    // R of the file turns the world into the camera (x_c = R (x_w − p)); the pose is kept as the
    // family has it, world_from_camera, with p the center in both.
    double q_cw[4];
    double p[3];
    if (!ReadRotation(q_cw) || !ReadNumbers("p", 3, p)) {
      return false;
    }
    // The file has camera_from_world; its inverse is the conjugate.
    keyframe.pose = {p[0], p[1], p[2], -q_cw[0], -q_cw[1], -q_cw[2], q_cw[3]};
    sequence_->keyframes.push_back(std::move(keyframe));
    return true;
  }

  // For any feature that has arrived, not only for those of the current keyframe: an odometry
  // corrects its guesses.
  bool ReadDepthGuess() {
    KeyframeDepthGuess guess;
    int anchor = 0;
    if (!ReadKeyframeNumber("i", &anchor) || !ReadFeatureOf(anchor, &guess.feature) ||
        !ReadNumbers("d", 1, &guess.inverse_depth)) {
      return false;
    }
    // 0 would say "not measured", which a guess need not say.
    if (!(guess.inverse_depth > 0.0)) {
      return Fail("d", "not positive");
    }
    current().depth_guesses.push_back(guess);
    return true;
  }

  bool ReadFeature() {
    KeyframeFeature feature;
    // The line names the keyframe above it, which is checked.
    feature.anchor = NumKeyframes() - 1;
    if (!ReadCurrentKeyframe() || !ReadIndex("k", &feature.index)) {
      return false;
    }
    const int position = static_cast<int>(sequence_->features.size());
    // Before the rest of the line is read: an error ends the file anyway.
    if (!feature_of_key_.emplace(Key(feature.anchor, feature.index), position).second) {
      return Fail("k", "feature " + std::to_string(feature.index) + " is twice in keyframe " +
                           std::to_string(feature.anchor));
    }
    if (!ReadImagePoint(&feature.x, &feature.y, &feature.inverse_depth)) {
      return false;
    }
    // Both lists grow only when the whole line is good.
    current().features.push_back(position);
    sequence_->features.push_back(feature);
    return true;
  }

  bool ReadObservation() {
    KeyframeObservation observation;
    int anchor = 0;
    if (!ReadCurrentKeyframe() || !ReadKeyframeNumber("a", &anchor)) {
      return false;
    }
    // The residual needs two poses: seen from its anchor, a feature is where it is by definition.
    if (anchor == NumKeyframes() - 1) {
      return Fail("a", "the observing keyframe itself");
    }
    // By anchor and number there, as in the line.
    double* const w = observation.information.data();
    if (!ReadFeatureOf(anchor, &observation.feature) ||
        !ReadImagePoint(&observation.x, &observation.y, &observation.inverse_depth) ||
        !ReadFields({{"w00", 1, w}, {"w01", 1, w + 1}, {"w11", 1, w + 2}})) {
      return false;
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
    return true;
  }

  // Odometry and loops alike. A loop arrives with the keyframe above it, which need not be one of
  // its two.
  bool ReadBetween() {
    KeyframeBetween between;
    if (!ReadKeyframeNumber("a", &between.a) || !ReadKeyframeNumber("b", &between.b)) {
      return false;
    }
    // Such a factor would have one variable in both of its slots.
    if (between.a == between.b) {
      return Fail("b", "keyframe " + std::to_string(between.b) + " with itself");
    }
    // All of the matrix, unlike that of an observation: so its symmetry can be checked, and is.
    if (!ReadRotation(between.q_ab.data()) ||
        !ReadFields({{"p", 3, between.p_ab.data()}, {"w", 36, between.information.data()}}) ||
        !CheckInformation(between.information)) {
      return false;
    }
    current().betweens.push_back(between);
    return true;
  }

  // Symmetric up to the digits that files print, measured by the diagonal. SqrtInformation reads
  // the upper triangle only and would not notice.
  bool CheckInformation(const std::array<double, 36>& w) {
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
    return SqrtInformation(w.data(), 6, ignored) || Fail("w", "not positive definite");
  }

  // Of any keyframe that has arrived, the current one included.
  bool ReadKeyframeNumber(const char* field, int* number) {
    return ReadIndex(field, number) &&
           (*number < NumKeyframes() ||
            Fail(field, "keyframe " + std::to_string(*number) + " has not arrived yet"));
  }

  // FEATURE and OBS repeat the number of their keyframe, which must be the one above.
  bool ReadCurrentKeyframe() {
    int number = 0;
    const int expected = NumKeyframes() - 1;
    return ReadIndex("i", &number) &&
           (number == expected ||
            Fail("i", std::to_string(number) + " is not the keyframe above, " +
                          std::to_string(expected)));
  }

  // By its key; `feature` is the index in the sequence.
  bool ReadFeatureOf(int anchor, int* feature) {
    int index = 0;
    if (!ReadIndex("k", &index)) {
      return false;
    }
    const auto found = feature_of_key_.find(Key(anchor, index));
    if (found == feature_of_key_.end()) {
      return Fail(
          "k", "keyframe " + std::to_string(anchor) + " has no feature " + std::to_string(index));
    }
    *feature = found->second;
    return true;
  }

  bool ReadImagePoint(double* x, double* y, double* inverse_depth) {
    // Written so that 0, which says that it was not measured, passes.
    return ReadFields({{"x", 1, x}, {"y", 1, y}, {"d_obs", 1, inverse_depth}}) &&
           (*inverse_depth >= 0.0 || Fail("d_obs", "negative"));
  }

  bool ReadRotation(double q[4]) {
    double R[9];
    return ReadNumbers("R", 9, R) && (QuaternionOf(R, q) || Fail("R", "not a rotation matrix"));
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
