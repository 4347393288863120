#include "io/bal_share.h"

#include <algorithm>
#include <climits>
#include <cstdio>
#include <memory>
#include <utility>

#include "io/byte_source.h"
#include "io/text_scanner.h"

// A BAL text read by several processes, each of which parses its own stretch of bytes only. Nothing
// in the text tells which number a byte belongs to, so it takes two passes: each process counts the
// numbers that begin in its stretch (CountTokens), all exchange their counts, and the sum of those
// before it tells each the number of its first one; then it knows which observation, camera or
// point that number belongs to, and parses (ReadBalShare).
//
// Two rules make all shares together the whole, whatever the borders are: a number belongs to the
// stretch that it begins in, and a record to the stretch that its first number begins in. So a
// share skips the end of a number and of a record that began before it, and reads on beyond its own
// end to complete its last record.
//
// Only for text that is not compressed: a compressed stream has no place to start from.

namespace inceres::internal {
namespace {

constexpr std::size_t kPiece = std::size_t{1} << 18;

// What TextScanner takes for white space: counting and parsing must cut the same numbers.
bool IsSpace(char c) {
  return c == ' ' || (c >= '\t' && c <= '\r');
}

// The bytes of a file from the first number on that begins at or behind a byte.
class TailSource final : public ByteSource {
 public:
  ~TailSource() override {
    if (file_ != nullptr) {
      std::fclose(file_);
    }
  }

  // Starts one byte early: only the byte before tells whether the one at `begin` begins a number or
  // is inside of one.
  Status Open(const std::string& path, std::int64_t begin) {
    file_ = std::fopen(path.c_str(), "rb");
    if (file_ == nullptr) {
      return Status::Error(StatusCode::kIo, path + ": " + SystemError());
    }
    if (begin == 0) {
      return Status::Ok();
    }
    if (fseeko(file_, static_cast<off_t>(begin) - 1, SEEK_SET) != 0) {
      return Status::Error(StatusCode::kIo, path + ": " + SystemError());
    }
    // Byte by byte, for a number's length at most; Read goes on from there.
    int c = std::fgetc(file_);
    while (c != EOF && !IsSpace(static_cast<char>(c))) {  // of a number that began before
      c = std::fgetc(file_);
      ++num_skipped_;
    }
    return Status::Ok();
  }

  // Up to the end of the file and not of the share: the last record may reach beyond it.
  Status Read(char* buffer, std::size_t capacity, std::size_t* size) override {
    *size = std::fread(buffer, 1, capacity, file_);
    return std::ferror(file_) == 0 ? Status::Ok() : Status::Error(StatusCode::kIo, SystemError());
  }

  /// Bytes of that number.
  std::int64_t num_skipped() const { return num_skipped_; }

 private:
  std::FILE* file_ = nullptr;
  std::int64_t num_skipped_ = 0;
};

// Numbers are counted through the file, from 0, the three counts of the head included: observations
// begin at 3, cameras where those end, points behind the cameras. token_ is the number that the
// scanner reads next, except that a record is counted when all of it is read: it may then be beyond
// end_.
class ShareReader {
 public:
  ShareReader(const std::string& path, std::unique_ptr<ByteSource> source, const BalCounts& counts)
      : scanner_(path, std::move(source)), counts_(counts) {}

  // A section that ends before this share does nothing but return; one that begins behind it finds
  // token_ at end_ already.
  Status Read(std::int64_t first_token, std::int64_t num_tokens, BalShare* share) {
    token_ = first_token;
    end_ = first_token + num_tokens;
    const std::int64_t observations_end = 3 + 4 * counts_.num_observations;
    const std::int64_t cameras_end =
        observations_end + BalProblem::kCameraSize * counts_.num_cameras;
    Status status = SkipTo(3);
    status = status.ok() ? ReadObservations(observations_end, share) : status;
    if (status.ok()) {
      status = ReadBlocks("camera", observations_end, cameras_end, BalProblem::kCameraSize,
                          &share->first_camera, &share->cameras);
    }
    return status.ok() ? ReadBlocks("point", cameras_end, counts_.NumTokens(),
                                    BalProblem::kPointSize, &share->first_point, &share->points)
                       : status;
  }

 private:
  // Over what belongs to another share, at most to the end of this one. Words, for what they say is
  // for others to judge.
  Status SkipTo(std::int64_t token) {
    for (; token_ < token && token_ < end_; ++token_) {
      std::string_view word;
      if (!scanner_.ScanWord(&word)) {
        return scanner_.Failure("number " + std::to_string(token_));
      }
    }
    return Status::Ok();
  }

  // To the first record of the section that begins here; its number.
  // The record that token_ is inside of has begun before and is the share's before: rounded up.
  Status SkipToRecord(std::int64_t begin, std::int64_t size, std::int64_t* first) {
    const std::int64_t at = std::max(token_, begin);
    // If the share begins before this section, `at` is the section's begin, and the record its
    // first.
    *first = (at - begin + size - 1) / size;
    return SkipTo(begin + *first * size);
  }

  Status ReadObservations(std::int64_t section_end, BalShare* share) {
    if (token_ >= section_end) {
      return Status::Ok();
    }
    Status status = SkipToRecord(3, 4, &share->first_observation);
    // Whole records, the last one beyond end_ if it must.
    for (; status.ok() && token_ < std::min(end_, section_end); token_ += 4) {
      BalObservation seen;
      status = ReadIndex("camera", counts_.num_cameras, &seen.camera);
      status = status.ok() ? ReadIndex("point", counts_.num_points, &seen.point) : status;
      if (status.ok() && !(scanner_.ScanDouble(&seen.x) && scanner_.ScanDouble(&seen.y))) {
        status = scanner_.Failure("observation");
      }
      share->observations.push_back(seen);
    }
    return status;
  }

  Status ReadIndex(const char* field, std::int64_t count, int* index) {
    std::int64_t value = -1;
    if (!scanner_.ScanInteger(&value)) {
      return scanner_.Failure(field);
    }
    if (value < 0 || value >= count) {
      return scanner_.FailureAt(scanner_.line(),
                                std::string(field) + ": index " + std::to_string(value) +
                                    " is not between 0 and " + std::to_string(count - 1));
    }
    *index = static_cast<int>(value);
    return Status::Ok();
  }

  // Cameras or points: records of `size` numbers from the number `begin` on.
  Status ReadBlocks(const char* what, std::int64_t begin, std::int64_t section_end,
                    std::int64_t size, std::int64_t* first, std::vector<double>* values) {
    if (token_ >= section_end) {
      return Status::Ok();
    }
    Status status = SkipToRecord(begin, size, first);
    for (; status.ok() && token_ < std::min(end_, section_end); token_ += size) {
      for (std::int64_t k = 0; status.ok() && k < size; ++k) {
        double value = 0.0;
        status = scanner_.ScanDouble(&value) ? status : scanner_.Failure(what);
        values->push_back(value);
      }
    }
    return status;
  }

  TextScanner scanner_;
  const BalCounts counts_;
  std::int64_t token_ = 0;
  std::int64_t end_ = 0;
};

}  // namespace

// Every process reads the head for itself; it is a few bytes.
Status ReadBalCounts(const std::string& path, BalCounts* counts, std::int64_t* file_bytes) {
  auto source = std::make_unique<FileSource>();
  Status status = source->Open(path);
  if (!status.ok()) {
    return status;
  }
  *file_bytes = source->file_bytes();
  TextScanner scanner(path, std::move(source));
  const std::pair<const char*, std::int64_t*> fields[] = {
      {"number of cameras", &counts->num_cameras},
      {"number of points", &counts->num_points},
      {"number of observations", &counts->num_observations}};
  for (const auto& [field, count] : fields) {
    if (!scanner.ScanInteger(count)) {
      return scanner.Failure(field);
    }
    if (*count < 1 || *count > INT_MAX) {
      return scanner.FailureAt(scanner.line(), std::string(field) + ": " + std::to_string(*count) +
                                                   " is not between 1 and " +
                                                   std::to_string(INT_MAX));
    }
  }
  return Status::Ok();
}

// A byte at a time through a buffer, without parsing. A number is counted where it begins: at the
// first byte behind white space.
Status CountTokens(const std::string& path, std::int64_t begin, std::int64_t end,
                   std::int64_t* num_tokens) {
  TailSource source;
  Status status = source.Open(path, begin);
  // Begins behind the number that was cut, with white space before it: `inside` is right.
  std::int64_t at = begin + source.num_skipped();
  std::vector<char> piece(kPiece);
  bool inside = false;
  *num_tokens = 0;
  while (status.ok() && at < end) {
    std::size_t size = 0;
    status = source.Read(piece.data(), piece.size(), &size);
    // The bytes behind `end` are the next share's.
    size = std::min(size, static_cast<std::size_t>(end - at));
    if (size == 0) {
      break;
    }
    for (std::size_t k = 0; k < size; ++k) {
      const bool space = IsSpace(piece[k]);
      *num_tokens += !space && !inside ? 1 : 0;
      inside = !space;
    }
    at += static_cast<std::int64_t>(size);
  }
  return status;
}

Status ReadBalShare(const std::string& path, const BalCounts& counts, std::int64_t begin,
                    std::int64_t first_token, std::int64_t num_tokens, BalShare* share) {
  auto source = std::make_unique<TailSource>();
  Status status = source->Open(path, begin);
  if (!status.ok()) {
    return status;
  }
  // Numbers are checked as in a whole file, so a share that is read is as good as one of ReadBal;
  // but its line numbers count from its own begin.
  BalShare read;
  status = ShareReader(path, std::move(source), counts).Read(first_token, num_tokens, &read);
  if (status.ok()) {
    *share = std::move(read);
  }
  return status;
}

}  // namespace inceres::internal
