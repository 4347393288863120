#pragma once

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "inceres/status.h"
#include "trust_region/loop_options.h"

namespace inceres::internal {

/// One variable of a checkpoint.
struct CheckpointRecord {
  enum Kind : std::int32_t { kFrame = 0, kLandmark = 1 };
  std::int64_t id = -1;
  std::int32_t kind = kFrame;
  std::int32_t ambient_size = 0;
  std::int32_t tangent_size = 0;
  std::int32_t unused = 0;
};

/// What the head of a checkpoint says of all of it.
struct CheckpointHead {
  LoopPosition position;  ///< without the scale, which is in the records
  int strategy_kind = 0;
  std::int64_t num_frames = 0;
  std::int64_t num_landmarks = 0;
};

/// What one rank has written: so many bytes, and what they sum to.
struct CheckpointSection {
  std::int64_t offset = 0;
  std::int64_t bytes = 0;
  std::uint64_t checksum = 0;
};

/// A checkpoint file: a head, a table of sections, and the sections, each of them records that
/// follow one another, a CheckpointRecord and then its values and the scale of its columns. Numbers
/// as this machine has them: little-endian, IEEE. All is checked by FNV-1a sums of 64 bits.

/// Appends a record.
void AppendRecord(const CheckpointRecord& record, const double* values, const double* scale,
                  std::vector<char>* section);
std::uint64_t ChecksumOf(const char* bytes, std::size_t count);
/// Head and table; sets the offsets of the sections, whose sizes and sums are given.
std::vector<char> EncodeHead(const CheckpointHead& head, std::vector<CheckpointSection>* sections);

/// Repeats a call of POSIX that a signal has interrupted; what it returned at last.
template <typename Call>
auto Uninterrupted(const Call& call) {
  auto result = call();
  while (result < 0 && errno == EINTR) {
    result = call();
  }
  return result;
}

/// Writes all bytes from `offset` on by calls write(bytes, count, offset), which return as pwrite
/// does and may write less than they are asked to. 0, or the errno that ended it: EIO where a call
/// has written nothing and given no reason.
template <typename Write>
int WriteAll(const std::vector<char>& bytes, std::int64_t offset, const Write& write) {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const auto count = Uninterrupted([&] {
      return write(bytes.data() + done, bytes.size() - done,
                   offset + static_cast<std::int64_t>(done));
    });
    if (count <= 0) {
      return count < 0 ? errno : EIO;
    }
    done += static_cast<std::size_t>(count);
  }
  return 0;
}

/// Nothing read is trusted: every count is checked against the size of the file before memory is
/// asked for. kIo names the file and what is wrong.
class CheckpointReader {
 public:
  /// Gets a record, its values and its scale; false: it is not acceptable, and reading ends.
  using Visit = std::function<bool(const CheckpointRecord& record, const double* values,
                                   const double* scale)>;

  Status Open(const std::string& path);
  const CheckpointHead& head() const { return head_; }
  /// Reads all records, a section at a time. kInvalidArgument if one is not acceptable.
  Status ForEach(const Visit& visit) const;

 private:
  Status ReadSection(const CheckpointSection& section, std::vector<char>* bytes) const;

  std::string path_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_{nullptr, &std::fclose};
  CheckpointHead head_;
  std::vector<CheckpointSection> sections_;
};

}  // namespace inceres::internal
