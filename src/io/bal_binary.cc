#include "io/bal_binary.h"

#include <algorithm>
#include <climits>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include "base/text.h"
#include "io/byte_stream.h"

// The binary form of a BAL problem (docs/file_formats.md, "BAL, binary"): head, index, then three
// arrays of records of fixed size, each array in blocks of 4096 records. Every offset follows from
// the counts in the head, so any stretch can be read with one seek, and checked with the sums of
// its own blocks, without looking at the rest: several processes read their shares of one file at
// the same time.
//
// The order of checks is the point: the head's counts are held against the size of the file before
// anything is allocated, the head and the index against the head's checksum, each block against its
// sum in the index, and only then are indices and numbers looked at, since a file may be intact and
// yet be nonsense.
//
// Records are copied as they are in memory; the byte order in the head refuses what a machine of
// another one has written.

namespace inceres::internal {
namespace {

constexpr char kMagic[8] = {'I', 'N', 'C', 'E', 'R', 'B', 'A', 'L'};
constexpr std::int32_t kVersion = 1;
// Reads as another number on a machine of the other byte order.
constexpr std::int32_t kByteOrder = 0x01020304;

// As it is in the file.
struct Head {
  char magic[8];
  std::int32_t version;
  std::int32_t byte_order;
  std::int64_t num_cameras;
  std::int64_t num_points;
  std::int64_t num_observations;
  std::int64_t block;      // records a block
  std::uint64_t checksum;  // of head and index, with 0 here
};
// Both structs are written byte by byte: no padding may be in them, or its bytes would be in the
// checksums.
static_assert(std::is_trivially_copyable_v<Head> && sizeof(Head) == 56);
static_assert(std::is_trivially_copyable_v<BalObservation> && sizeof(BalObservation) == 24);

// By Section.
constexpr std::int64_t kRecordBytes[] = {
    24, static_cast<std::int64_t>(sizeof(double)) * BalProblem::kCameraSize,
    static_cast<std::int64_t>(sizeof(double)) * BalProblem::kPointSize};
constexpr const char* kRecordNames[] = {"observation", "camera", "point"};

// FNV-1a, 64 bits, by words: records are whole ones.
// The shift is not part of FNV: multiplying moves bits only upward, and it brings the upper ones
// back down. Bytes beyond the last whole word would be left out; none of the records has any.
std::uint64_t Checksum(const char* bytes, std::size_t count, std::uint64_t hash) {
  for (std::size_t k = 0; k + 8 <= count; k += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes + k, sizeof word);
    hash = (hash ^ word) * 0x100000001b3U;
    hash ^= hash >> 29;
  }
  return hash;
}

// FNV's offset basis.
constexpr std::uint64_t kSeed = 0xcbf29ce484222325U;

// Head and index in one sum: a block's sum can be trusted once this one is right.
std::uint64_t ChecksumOfHead(Head head, const std::vector<std::uint64_t>& index) {
  head.checksum = 0;
  const std::uint64_t hash = Checksum(reinterpret_cast<const char*>(&head), sizeof head, kSeed);
  return Checksum(reinterpret_cast<const char*>(index.data()), index.size() * sizeof index[0],
                  hash);
}

// At most INT_MAX, for indices are ints in memory; and 24, 72 or 24 bytes times that cannot
// overflow.
bool IsCount(std::int64_t count) {
  return count >= 1 && count <= INT_MAX;
}

// The first number of a block that is none.
// Its size if there is none such.
std::ptrdiff_t FindNotFinite(const std::vector<double>& values) {
  return std::find_if(values.begin(), values.end(), [](double x) { return !std::isfinite(x); }) -
         values.begin();
}

}  // namespace

bool IsBalBinary(const std::string& path) {
  return EndsWith(path, ".balb");
}

BalBinaryFile::~BalBinaryFile() {
  if (file_ != nullptr) {
    std::fclose(file_);
  }
}

Status BalBinaryFile::Wrong(const std::string& what) const {
  return Status::Error(StatusCode::kIo, path_ + ": " + what);
}

std::int64_t BalBinaryFile::CountOf(int section) const {
  return section == kObservations ? counts_.num_observations
         : section == kCameras    ? counts_.num_cameras
                                  : counts_.num_points;
}

std::int64_t BalBinaryFile::NumBlocks(int section) const {
  return (CountOf(section) + kBlock - 1) / kBlock;
}

// Once per object. 64-bit offsets throughout (fseeko, ftello): large problems have files beyond 2
// GiB.
Status BalBinaryFile::Open(const std::string& path) {
  path_ = path;
  file_ = std::fopen(path.c_str(), "rb");
  if (file_ == nullptr) {
    return Wrong("cannot open for reading: " + SystemError());
  }
  // A pipe has no size and cannot be sought in: it is refused here.
  if (fseeko(file_, 0, SEEK_END) != 0 || (file_bytes_ = ftello(file_)) < 0 ||
      fseeko(file_, 0, SEEK_SET) != 0) {
    return Wrong("cannot be read as a regular file: " + SystemError());
  }
  return ReadHead();
}

// Reads head and index, and lays out the file: where each section begins, and which block of the
// index is its first.
Status BalBinaryFile::ReadHead() {
  Head head;
  if (std::fread(&head, sizeof head, 1, file_) != 1) {
    return Wrong("is too short for a binary BAL file");
  }
  if (std::memcmp(head.magic, kMagic, sizeof kMagic) != 0) {
    return Wrong("is no binary BAL file, though its name says so");
  }
  // The block size is a constant of version 1: with another one, the index would have another size.
  if (head.version != kVersion || head.byte_order != kByteOrder || head.block != kBlock) {
    return Wrong("is of version " + std::to_string(head.version) +
                 ", or of a machine with other byte order; this reads version " +
                 std::to_string(kVersion));
  }
  if (!IsCount(head.num_cameras) || !IsCount(head.num_points) || !IsCount(head.num_observations)) {
    return Wrong("counts are not between 1 and " + std::to_string(INT_MAX));
  }
  counts_ = {head.num_cameras, head.num_points, head.num_observations};
  std::int64_t num_blocks = 0;
  for (int s = 0; s < kNumSections; ++s) {
    first_block_[s] = num_blocks;
    num_blocks += NumBlocks(s);
  }
  std::int64_t end = static_cast<std::int64_t>(sizeof head) + 8 * num_blocks;
  for (int s = 0; s < kNumSections; ++s) {
    data_begin_[s] = end;
    end += kRecordBytes[s] * CountOf(s);
  }
  // Both a truncated file and counts that are wrong end here, before memory is asked for.
  if (end != file_bytes_) {
    return Wrong("has " + std::to_string(file_bytes_) + " bytes; its counts ask for " +
                 std::to_string(end));
  }
  index_.resize(static_cast<std::size_t>(num_blocks));
  if (std::fread(index_.data(), sizeof index_[0], index_.size(), file_) != index_.size()) {
    return Wrong("cannot read its index: " + SystemError());
  }
  // Progress is told of all of the file, which begins with these.
  bytes_read_ = static_cast<std::int64_t>(sizeof head + index_.size() * sizeof index_[0]);
  return ChecksumOfHead(head, index_) == head.checksum ? Status::Ok()
                                                       : Wrong("the checksum of its head is wrong");
}

// One seek, then block after block: each is read, held against its sum while it is in the cache,
// and told of. A stretch may be empty, where there are more parts than blocks, and the last block
// may be short.
Status BalBinaryFile::ReadBlocks(int section, std::int64_t begin, std::int64_t end,
                                 std::vector<char>* bytes, const ReadProgress& progress) {
  const std::int64_t record = kRecordBytes[section];
  const std::int64_t first = begin * kBlock;
  const std::int64_t last = std::min(end * kBlock, CountOf(section));
  bytes->resize(static_cast<std::size_t>(std::max<std::int64_t>(0, last - first) * record));
  const auto unread = [&] {
    return Wrong(std::string("cannot read its ") + kRecordNames[section] + "s: " + SystemError());
  };
  if (fseeko(file_, static_cast<off_t>(data_begin_[section] + first * record), SEEK_SET) != 0) {
    return unread();
  }
  for (std::int64_t b = begin; b < end; ++b) {
    // The last block of a section may be short: it has what is left of the bytes.
    const auto at = static_cast<std::size_t>((b - begin) * kBlock * record);
    const std::size_t size =
        std::min(static_cast<std::size_t>(kBlock * record), bytes->size() - at);
    if (std::fread(bytes->data() + at, 1, size, file_) != size) {
      return unread();
    }
    if (Checksum(bytes->data() + at, size, kSeed) !=
        index_[static_cast<std::size_t>(first_block_[section] + b)]) {
      return Wrong(std::string("the checksum of the ") + kRecordNames[section] + "s from " +
                   std::to_string(b * kBlock) + " on is wrong");
    }
    bytes_read_ += static_cast<std::int64_t>(size);
    if (progress) {
      progress(bytes_read_, file_bytes_);
    }
  }
  return Status::Ok();
}

// Parts end at block boundaries, so that each part can check what it has read by itself: part p has
// the blocks [⌊n p / parts⌋, ⌊n (p + 1) / parts⌋) of each section, which cover all blocks once.
Status BalBinaryFile::ReadShare(int part, int num_parts, BalShare* share,
                                const ReadProgress& progress) {
  BalShare read;
  std::vector<char> bytes;
  std::int64_t firsts[kNumSections];
  for (int s = 0; s < kNumSections; ++s) {
    const std::int64_t begin = NumBlocks(s) * part / num_parts;
    const std::int64_t end = NumBlocks(s) * (part + 1) / num_parts;
    firsts[s] = begin * kBlock;
    if (Status status = ReadBlocks(s, begin, end, &bytes, progress); !status.ok()) {
      return status;
    }
    if (s == kObservations) {
      read.observations.resize(bytes.size() / sizeof(BalObservation));
      // The bytes are copied rather than taken for records where they are: their buffer has no
      // type.
      std::copy_n(bytes.data(), bytes.size(), reinterpret_cast<char*>(read.observations.data()));
      continue;
    }
    std::vector<double>& values = s == kCameras ? read.cameras : read.points;
    values.resize(bytes.size() / sizeof(double));
    std::copy_n(bytes.data(), bytes.size(), reinterpret_cast<char*>(values.data()));
    if (const std::ptrdiff_t bad = FindNotFinite(values);
        bad < static_cast<std::ptrdiff_t>(values.size())) {
      const std::int64_t record =
          firsts[s] + bad * static_cast<std::int64_t>(sizeof(double)) / kRecordBytes[s];
      return Wrong(std::string(kRecordNames[s]) + " " + std::to_string(record) + ": is not finite");
    }
  }
  read.first_observation = firsts[kObservations];
  read.first_camera = firsts[kCameras];
  read.first_point = firsts[kPoints];
  // An index may be that of a record of another part; the counts are those of the whole file.
  for (std::size_t k = 0; k < read.observations.size(); ++k) {
    const BalObservation& seen = read.observations[k];
    const bool fits = seen.camera >= 0 && seen.camera < counts_.num_cameras && seen.point >= 0 &&
                      seen.point < counts_.num_points && std::isfinite(seen.x) &&
                      std::isfinite(seen.y);
    if (!fits) {
      return Wrong("observation " +
                   std::to_string(read.first_observation + static_cast<std::int64_t>(k)) +
                   ": an index out of range, or a number that is not finite");
    }
  }
  *share = std::move(read);
  return Status::Ok();
}

// The whole file as the only share. `problem` is written to only when nothing can fail any more.
Status ReadBalBinary(const std::string& path, BalProblem* problem, const ReadProgress& progress) {
  BalBinaryFile file;
  BalShare all;
  Status status = file.Open(path);
  status = status.ok() ? file.ReadShare(0, 1, &all, progress) : status;
  if (status.ok()) {
    problem->num_cameras = static_cast<int>(file.counts().num_cameras);
    problem->num_points = static_cast<int>(file.counts().num_points);
    problem->observations = std::move(all.observations);
    problem->cameras = std::move(all.cameras);
    problem->points = std::move(all.points);
  }
  return status;
}

// Requires a problem that Validate()s: its arrays then have the sizes that the counts in the head
// say. The sums come before the records in the file, so there are two passes over memory and none
// back in the file, which may be a pipe.
Status WriteBalBinary(const std::string& path, const BalProblem& problem) {
  const std::pair<const char*, std::size_t> sections[] = {
      {reinterpret_cast<const char*>(problem.observations.data()),
       problem.observations.size() * sizeof(BalObservation)},
      {reinterpret_cast<const char*>(problem.cameras.data()),
       problem.cameras.size() * sizeof(double)},
      {reinterpret_cast<const char*>(problem.points.data()),
       problem.points.size() * sizeof(double)}};
  std::vector<std::uint64_t> index;
  for (int s = 0; s < BalBinaryFile::kNumSections; ++s) {
    const auto block = static_cast<std::size_t>(BalBinaryFile::kBlock * kRecordBytes[s]);
    const auto& [bytes, size] = sections[s];
    for (std::size_t at = 0; at < size; at += block) {
      index.push_back(Checksum(bytes + at, std::min(block, size - at), kSeed));
    }
  }
  // Zeroed first: the checksum is taken with 0 in its own place.
  Head head{};
  std::memcpy(head.magic, kMagic, sizeof kMagic);
  head.version = kVersion;
  head.byte_order = kByteOrder;
  head.num_cameras = problem.num_cameras;
  head.num_points = problem.num_points;
  head.num_observations = static_cast<std::int64_t>(problem.observations.size());
  head.block = BalBinaryFile::kBlock;
  head.checksum = ChecksumOfHead(head, index);
  FileSink sink;
  Status status = sink.Open(path);
  status = status.ok() ? sink.Write(reinterpret_cast<const char*>(&head), sizeof head) : status;
  status = status.ok() ? sink.Write(reinterpret_cast<const char*>(index.data()),
                                    index.size() * sizeof index[0])
                       : status;
  for (const auto& [bytes, size] : sections) {
    status = status.ok() ? sink.Write(bytes, size) : status;
  }
  return status.ok() ? sink.Finish() : status;
}

}  // namespace inceres::internal
