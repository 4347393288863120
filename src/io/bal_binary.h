#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/io/bal.h"
#include "inceres/status.h"

namespace inceres::internal {

/// How much a BAL file says it has.
struct BalCounts {
  std::int64_t num_cameras = 0;
  std::int64_t num_points = 0;
  std::int64_t num_observations = 0;
};

/// A stretch of each of the three parts of a BAL file.
struct BalShare {
  std::int64_t first_observation = 0;
  std::vector<BalObservation> observations;
  std::int64_t first_camera = 0;
  std::vector<double> cameras;  ///< nine a camera
  std::int64_t first_point = 0;
  std::vector<double> points;  ///< three a point
};

/// Whether a file of this name is one.
INCERES_EXPORT bool IsBalBinary(const std::string& path);

/// A BAL problem in binary form (docs/file_formats.md, "BAL, binary"): a head, an index of
/// checksums of blocks of records, and the records, each at a place that follows from the counts.
///
/// Nothing read is trusted: the counts are checked against the size of the file before memory is
/// asked for, every block against its sum, every index and number when it is read. Errors are kIo
/// and name the file and the record.
class INCERES_EXPORT BalBinaryFile {
 public:
  static constexpr std::int64_t kBlock = 4096;  ///< records
  /// The three kinds of records, in the order of the file.
  enum Section { kObservations, kCameras, kPoints, kNumSections };

  BalBinaryFile() = default;
  ~BalBinaryFile();
  BalBinaryFile(const BalBinaryFile&) = delete;
  BalBinaryFile& operator=(const BalBinaryFile&) = delete;

  Status Open(const std::string& path);
  const BalCounts& counts() const { return counts_; }

  /// Reads the part-th of num_parts stretches of blocks of each section: all parts together have
  /// each record once. On an error *share is as before.
  Status ReadShare(int part, int num_parts, BalShare* share,
                   const ReadProgress& progress = nullptr);

 private:
  std::int64_t CountOf(int section) const;
  std::int64_t NumBlocks(int section) const;
  Status ReadHead();
  /// The bytes of the blocks [begin, end) of a section, checked; progress is told of each.
  Status ReadBlocks(int section, std::int64_t begin, std::int64_t end, std::vector<char>* bytes,
                    const ReadProgress& progress);
  Status Wrong(const std::string& what) const;

  std::string path_;
  std::FILE* file_ = nullptr;
  std::int64_t file_bytes_ = 0;
  std::int64_t bytes_read_ = 0;  // head, index, and the blocks that were asked for
  std::int64_t data_begin_[kNumSections] = {0, 0, 0};
  std::int64_t first_block_[kNumSections] = {0, 0, 0};  // in the index
  std::vector<std::uint64_t> index_;
  BalCounts counts_;
};

/// As ReadBal and WriteBal of such files.
Status ReadBalBinary(const std::string& path, BalProblem* problem, const ReadProgress& progress);
Status WriteBalBinary(const std::string& path, const BalProblem& problem);

}  // namespace inceres::internal
