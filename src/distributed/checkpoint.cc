#include "distributed/checkpoint.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <system_error>
#include <utility>

namespace inceres::internal {

// The file format of checkpoints (docs/distributed.md, "Go on after an end"):
//
//     FixedHead | CheckpointSection of each rank that wrote | section | section | …
//
// A section is records one after the other: CheckpointRecord, the values (ambient size), the scale
// s_j of the columns (tangent size). Names are ids, not positions, so that any number of ranks can
// read what any other number has written.
//
// Two kinds of damage are told apart: of head and table by one FNV-1a sum, and of each section by
// its own, which is checked before a record of it is believed. The sections must follow one another
// without a gap up to the last byte, so a file that was cut, or to which something was appended, is
// refused before a section is read.

namespace {

constexpr char kMagic[8] = {'I', 'N', 'C', 'E', 'R', 'C', 'K', 'P'};
constexpr std::int32_t kVersion = 2;
// Reads as another number on a machine of the other byte order.
constexpr std::int32_t kByteOrder = 0x01020304;
// Room in the head for TrustRegionStrategy::Save: six numbers of Levenberg–Marquardt, two of
// Dog-Leg.
constexpr std::int32_t kMaxStrategyNumbers = 8;
// Above it a size counts as damage; the bytes of a record then cannot overflow.
constexpr std::int32_t kMaxVariableSize = 1 << 20;

// As it is in the file.
// Fields are ordered such that there is no padding: all bytes count for the checksum.
struct FixedHead {
  char magic[8];
  std::int32_t version;
  std::int32_t byte_order;
  std::uint64_t checksum;  // of head and table, with 0 here
  std::int64_t num_sections;
  std::int64_t num_frames;
  std::int64_t num_landmarks;
  std::int32_t iteration;
  std::int32_t strategy_kind;
  std::int32_t num_successful_steps;
  std::int32_t num_unsuccessful_steps;
  std::int32_t num_consecutive_invalid_steps;
  std::int32_t any_step_accepted;
  std::int32_t num_strategy_numbers;
  std::int32_t unused;
  double initial_cost;
  double strategy[kMaxStrategyNumbers];
};

// All that is wrong with a file is kIo, and begins with its name.
Status Wrong(const std::string& path, const std::string& what) {
  return Status::Error(StatusCode::kIo, path + ": " + what);
}

std::string LastError() {
  return std::generic_category().message(errno);
}

// Bytes of what follows a record, or −1.
std::int64_t PayloadOf(const CheckpointRecord& record) {
  const bool sane = record.ambient_size >= 1 && record.ambient_size <= kMaxVariableSize &&
                    record.tangent_size >= 1 && record.tangent_size <= kMaxVariableSize;
  return sane ? static_cast<std::int64_t>(sizeof(double)) *
                    (std::int64_t{record.ambient_size} + record.tangent_size)
              : -1;
}

// What must be true before the table is read: counts come from the file, and memory is asked for by
// them only after this.
Status CheckHead(const std::string& path, const FixedHead& head, std::int64_t file_bytes) {
  if (std::memcmp(head.magic, kMagic, sizeof kMagic) != 0) {
    return Wrong(path, "is no checkpoint of inceres");
  }
  if (head.version != kVersion || head.byte_order != kByteOrder) {
    return Wrong(path, "a checkpoint of version " + std::to_string(head.version) +
                           ", or of a machine with other byte order; this reads version " +
                           std::to_string(kVersion));
  }
  // A quotient, since num_sections times the size of an entry could overflow.
  const std::int64_t room = file_bytes - static_cast<std::int64_t>(sizeof(FixedHead));
  if (head.num_sections < 0 ||
      head.num_sections > room / static_cast<std::int64_t>(sizeof(CheckpointSection))) {
    return Wrong(path, "has " + std::to_string(head.num_sections) +
                           " sections by its head, more than its bytes can hold");
  }
  return Status::Ok();
}

// The checksum protects from damage, this from a file that was made wrong: the numbers go into the
// trust-region loop as they are. Iteration 0 counts as a successful step, hence at least one. The
// first number of a strategy is its radius, which is positive; the others are not negative.
Status CheckNumbers(const std::string& path, const FixedHead& head) {
  const bool sane = head.num_frames >= 0 && head.num_landmarks >= 0 && head.iteration >= 0 &&
                    head.num_successful_steps >= 1 && head.num_unsuccessful_steps >= 0 &&
                    head.num_consecutive_invalid_steps >= 0 && head.num_strategy_numbers >= 1 &&
                    head.num_strategy_numbers <= kMaxStrategyNumbers &&
                    std::isfinite(head.initial_cost);
  bool positive = sane;
  for (int k = 0; positive && k < head.num_strategy_numbers; ++k) {
    positive = std::isfinite(head.strategy[k]) && head.strategy[k] >= 0.0;
  }
  return positive && head.strategy[0] > 0.0 ? Status::Ok()
                                            : Wrong(path, "the numbers of its head make no sense");
}

// Sums head and table as EncodeHead has: with zero where the checksum is.
Status CheckSum(const std::string& path, FixedHead head,
                const std::vector<CheckpointSection>& sections) {
  const std::uint64_t checksum = std::exchange(head.checksum, 0);
  std::vector<char> bytes(sizeof head + sections.size() * sizeof(CheckpointSection));
  std::memcpy(bytes.data(), &head, sizeof head);
  if (!sections.empty()) {
    std::memcpy(bytes.data() + sizeof head, sections.data(), bytes.size() - sizeof head);
  }
  return ChecksumOf(bytes.data(), bytes.size()) == checksum
             ? Status::Ok()
             : Wrong(path, "the checksum of its head is wrong");
}

// Sections follow one another from the end of the table to that of the file.
Status CheckSections(const std::string& path, const std::vector<CheckpointSection>& sections,
                     std::int64_t file_bytes) {
  auto offset =
      static_cast<std::int64_t>(sizeof(FixedHead) + sections.size() * sizeof(CheckpointSection));
  for (const CheckpointSection& section : sections) {
    // `offset` never exceeds file_bytes here, so the difference does not overflow.
    if (section.offset != offset || section.bytes < 0 || section.bytes > file_bytes - offset) {
      return Wrong(path, "a section is not within the file, which may have been cut");
    }
    offset += section.bytes;
  }
  return offset == file_bytes ? Status::Ok() : Wrong(path, "has bytes behind the last section");
}

// What EncodeHead has encoded; the numbers have been checked.
CheckpointHead Decode(const FixedHead& fixed) {
  CheckpointHead head;
  head.position.iteration = fixed.iteration;
  head.position.initial_cost = fixed.initial_cost;
  head.position.any_step_accepted = fixed.any_step_accepted != 0;
  head.position.num_consecutive_invalid_steps = fixed.num_consecutive_invalid_steps;
  head.position.num_successful_steps = fixed.num_successful_steps;
  head.position.num_unsuccessful_steps = fixed.num_unsuccessful_steps;
  head.position.strategy.assign(fixed.strategy, fixed.strategy + fixed.num_strategy_numbers);
  head.strategy_kind = fixed.strategy_kind;
  head.num_frames = fixed.num_frames;
  head.num_landmarks = fixed.num_landmarks;
  return head;
}

}  // namespace

// FNV-1a, 64 bits: offset basis and prime are those of its definition.
std::uint64_t ChecksumOf(const char* bytes, std::size_t count) {
  std::uint64_t hash = 0xcbf29ce484222325U;
  for (std::size_t k = 0; k < count; ++k) {
    hash = (hash ^ static_cast<unsigned char>(bytes[k])) * 0x100000001b3U;
  }
  return hash;
}

// Values and scale follow their record without alignment; ForEach copies them out again.
void AppendRecord(const CheckpointRecord& record, const double* values, const double* scale,
                  std::vector<char>* section) {
  const auto append = [section](const void* data, std::size_t size) {
    const char* const bytes = static_cast<const char*>(data);
    section->insert(section->end(), bytes, bytes + size);
  };
  append(&record, sizeof record);
  append(values, static_cast<std::size_t>(record.ambient_size) * sizeof(double));
  append(scale, static_cast<std::size_t>(record.tangent_size) * sizeof(double));
}

// Sections begin right behind the table, in the order of the ranks: with all sizes known, each rank
// can write its own place by itself. The sum is taken with zero in its own field, and written over
// it.
std::vector<char> EncodeHead(const CheckpointHead& head, std::vector<CheckpointSection>* sections) {
  FixedHead fixed{};
  std::memcpy(fixed.magic, kMagic, sizeof kMagic);
  fixed.version = kVersion;
  fixed.byte_order = kByteOrder;
  fixed.num_sections = static_cast<std::int64_t>(sections->size());
  fixed.num_frames = head.num_frames;
  fixed.num_landmarks = head.num_landmarks;
  fixed.iteration = head.position.iteration;
  fixed.strategy_kind = head.strategy_kind;
  fixed.num_successful_steps = head.position.num_successful_steps;
  fixed.num_unsuccessful_steps = head.position.num_unsuccessful_steps;
  fixed.num_consecutive_invalid_steps = head.position.num_consecutive_invalid_steps;
  fixed.any_step_accepted = head.position.any_step_accepted ? 1 : 0;
  fixed.initial_cost = head.position.initial_cost;
  // At most kMaxStrategyNumbers: no strategy saves more.
  for (const double number : head.position.strategy) {
    fixed.strategy[fixed.num_strategy_numbers++] = number;
  }
  const std::size_t table_bytes = sections->size() * sizeof(CheckpointSection);
  auto offset = static_cast<std::int64_t>(sizeof fixed + table_bytes);
  for (CheckpointSection& section : *sections) {
    section.offset = offset;
    offset += section.bytes;
  }
  std::vector<char> bytes(sizeof fixed + table_bytes);
  std::memcpy(bytes.data(), &fixed, sizeof fixed);
  std::memcpy(bytes.data() + sizeof fixed, sections->data(), table_bytes);
  fixed.checksum = ChecksumOf(bytes.data(), bytes.size());
  std::memcpy(bytes.data(), &fixed, sizeof fixed);
  return bytes;
}

// Reads head and table and checks them against the size of the file. The order is part of the
// safety: magic and version, the count of sections, the checksum, the extents of sections, the
// numbers. Sections themselves are read by ForEach.
Status CheckpointReader::Open(const std::string& path) {
  path_ = path;
  file_.reset(std::fopen(path.c_str(), "rb"));
  std::FILE* const file = file_.get();
  if (file == nullptr) {
    return Wrong(path, "cannot open for reading: " + LastError());
  }
  FixedHead fixed{};
  if (std::fseek(file, 0, SEEK_END) != 0) {
    return Wrong(path, "cannot read: " + LastError());
  }
  const std::int64_t file_bytes = std::ftell(file);
  std::rewind(file);
  if (std::fread(&fixed, sizeof fixed, 1, file) != 1) {
    return Wrong(path, "is too short for a checkpoint");
  }
  Status status = CheckHead(path, fixed, file_bytes);
  if (!status.ok()) {
    return status;
  }
  sections_.resize(static_cast<std::size_t>(fixed.num_sections));
  if (!sections_.empty() && std::fread(sections_.data(), sizeof(CheckpointSection),
                                       sections_.size(), file) != sections_.size()) {
    return Wrong(path, "ends within its table");
  }
  status = CheckSum(path, fixed, sections_);
  status = status.ok() ? CheckSections(path, sections_, file_bytes) : status;
  status = status.ok() ? CheckNumbers(path, fixed) : status;
  if (status.ok()) {
    head_ = Decode(fixed);
  }
  return status;
}

// One section is in memory at a time.
Status CheckpointReader::ReadSection(const CheckpointSection& section,
                                     std::vector<char>* bytes) const {
  bytes->resize(static_cast<std::size_t>(section.bytes));
  if (fseeko(file_.get(), static_cast<off_t>(section.offset), SEEK_SET) != 0 ||
      std::fread(bytes->data(), 1, bytes->size(), file_.get()) != bytes->size()) {
    return Wrong(path_, "cannot read a section: " + LastError());
  }
  return ChecksumOf(bytes->data(), bytes->size()) == section.checksum
             ? Status::Ok()
             : Wrong(path_, "the checksum of a section is wrong");
}

// Every rank reads all sections, and picks what it has by id. `numbers` is a copy that is aligned;
// the scale begins where the values end.
Status CheckpointReader::ForEach(const Visit& visit) const {
  std::vector<char> bytes;
  std::vector<double> numbers;
  for (const CheckpointSection& section : sections_) {
    if (Status status = ReadSection(section, &bytes); !status.ok()) {
      return status;
    }
    for (std::size_t at = 0; at < bytes.size();) {
      CheckpointRecord record;
      // Comparisons subtract from the size, which cannot wrap, as at ≤ size.
      if (bytes.size() - at < sizeof record) {
        return Wrong(path_, "a section ends within a record");
      }
      std::memcpy(&record, bytes.data() + at, sizeof record);
      at += sizeof record;
      const std::int64_t payload = PayloadOf(record);
      if (payload < 0 || static_cast<std::size_t>(payload) > bytes.size() - at) {
        return Wrong(path_,
                     "variable " + std::to_string(record.id) + " has a size that makes no sense");
      }
      numbers.resize(static_cast<std::size_t>(payload) / sizeof(double));
      std::memcpy(numbers.data(), bytes.data() + at, static_cast<std::size_t>(payload));
      at += static_cast<std::size_t>(payload);
      if (!visit(record, numbers.data(), numbers.data() + record.ambient_size)) {
        return Status::Error(StatusCode::kInvalidArgument,
                             path_ + ": " + (record.kind == 0 ? "frame " : "landmark ") +
                                 std::to_string(record.id) +
                                 " is not as the problem has it: a checkpoint of another one?");
      }
    }
  }
  return Status::Ok();
}

}  // namespace inceres::internal
