#include <algorithm>
#include <climits>
#include <string>

#include "inceres/io/bal.h"
#include "io/bal_binary.h"
#include "io/record_reader.h"

// The text form of BAL (docs/file_formats.md, "BAL"): one stream of numbers in which line ends mean
// nothing, read in one pass by a scanner that knows the line it is in. What a message calls a
// number is worked out only when it is wrong: millions of numbers are read without a string being
// made.

namespace inceres {
namespace internal {
namespace {

// A count in a header may be wrong: what it says is not allocated before that much data has really
// come.
constexpr std::int64_t kMaxReserved = std::int64_t{1} << 20;

// What messages call the numbers of a record; kCameraSize and kPointSize of them.
constexpr const char* kCameraFields[] = {
    "angle-axis x", "angle-axis y", "angle-axis z", "t x", "t y", "t z", "f", "k1", "k2"};
constexpr const char* kPointFields[] = {"x", "y", "z"};

// Reads into a problem of its caller (ReadFile), who throws it away after a failure: what is half
// filled is never seen.
class BalReader : private RecordReader {
 public:
  using RecordReader::RecordReader;

  // The sections in the order of the file; what is wrong in one ends the read there, since
  // everything behind it would be shifted.
  Status Read(BalProblem* problem) {
    // Surplus data is an error: too small a count in the header would otherwise go unnoticed, and
    // make points of what are cameras.
    if (ReadHeader(problem) && ReadObservations(problem) &&
        ReadBlocks("camera", problem->num_cameras, kCameraFields, BalProblem::kCameraSize,
                   &problem->cameras) &&
        ReadBlocks("point", problem->num_points, kPointFields, BalProblem::kPointSize,
                   &problem->points) &&
        !scanner_.AtEnd()) {
      Missing("after the last point (are the counts of the header right?)");
    }
    return status_;
  }

 private:
  // The order of the file: cameras, points, observations.
  bool ReadHeader(BalProblem* problem) {
    return ReadCount("number of cameras", &problem->num_cameras) &&
           ReadCount("number of points", &problem->num_points) &&
           ReadCount("number of observations", &num_observations_);
  }

  bool ReadCount(const char* field, int* count) {
    std::int64_t value = 0;
    if (!scanner_.ScanInteger(&value)) {
      return Missing(field);
    }
    if (value < 1 || value > INT_MAX) {
      return Fail(field,
                  std::to_string(value) + " is not between 1 and " + std::to_string(INT_MAX));
    }
    *count = static_cast<int>(value);
    return true;
  }

  // Four numbers each. Indices are checked as they come, so that the message names the line.
  bool ReadObservations(BalProblem* problem) {
    // At most 2^20 records ahead: a header of a few bytes may ask for billions.
    problem->observations.reserve(
        static_cast<std::size_t>(std::min<std::int64_t>(num_observations_, kMaxReserved)));
    for (int i = 0; i < num_observations_; ++i) {
      BalObservation observation;
      if (!ReadIndex(problem->num_cameras, &observation.camera)) {
        return IndexFailure(i, "camera", problem->num_cameras);
      }
      if (!ReadIndex(problem->num_points, &observation.point)) {
        return IndexFailure(i, "point", problem->num_points);
      }
      if (!scanner_.ScanDouble(&observation.x)) {
        return Missing(Entry("observation", i, "x"));
      }
      if (!scanner_.ScanDouble(&observation.y)) {
        return Missing(Entry("observation", i, "y"));
      }
      problem->observations.push_back(observation);
    }
    return true;
  }

  // False for what is no integer and for what is out of range; IndexFailure, which is called right
  // after that, tells one from the other by what is kept here. The value is narrowed before it is
  // checked, but used only if it fits.
  bool ReadIndex(int size, int* index) {
    index_scanned_ = scanner_.ScanInteger(&last_index_);
    *index = static_cast<int>(last_index_);
    return index_scanned_ && last_index_ >= 0 && last_index_ < size;
  }

  bool IndexFailure(int observation, const char* field, int size) {
    const std::string entry = Entry("observation", observation, field);
    if (!index_scanned_) {
      return Missing(entry);
    }
    // The token scanned well, so the message has the number rather than the text.
    return Fail(entry, "index " + std::to_string(last_index_) + " is not between 0 and " +
                           std::to_string(size - 1));
  }

  // `count` records of `size` numbers, whose names are `fields`: cameras, then points.
  bool ReadBlocks(const char* what, int count, const char* const* fields, int size,
                  std::vector<double>* values) {
    values->reserve(
        static_cast<std::size_t>(std::min<std::int64_t>(std::int64_t{count} * size, kMaxReserved)));
    for (int i = 0; i < count; ++i) {
      for (int k = 0; k < size; ++k) {
        double value = 0.0;
        if (!scanner_.ScanDouble(&value)) {
          return Missing(Entry(what, i, fields[k]));
        }
        values->push_back(value);
      }
    }
    return true;
  }

  // "camera 17: k1".
  static std::string Entry(const char* what, int index, const char* field) {
    return std::string(what) + " " + std::to_string(index) + ": " + field;
  }

  int num_observations_ = 0;
  // Of the last call of ReadIndex.
  std::int64_t last_index_ = 0;
  bool index_scanned_ = false;
};

}  // namespace
}  // namespace internal

// The name alone decides: the binary form has no compressed variant, and its size is checked by its
// counts rather than limited by options.
Status ReadBal(const std::string& path, BalProblem* problem, const ReadProgress& progress,
               const ReadOptions& options) {
  if (internal::IsBalBinary(path)) {
    return internal::ReadBalBinary(path, problem, progress);
  }
  return internal::ReadFile<internal::BalReader>(path, problem, options, progress);
}

}  // namespace inceres
