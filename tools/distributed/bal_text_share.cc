#include "tools/distributed/bal_text_share.h"

#include <algorithm>
#include <climits>
#include <cstdio>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "io/byte_stream.h"
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

namespace inceres::tools {
namespace {

using internal::BalCounts;
using internal::BalShare;
using internal::FileSource;
using internal::TextScanner;

constexpr std::size_t kPiece = std::size_t{1} << 18;

// What TextScanner takes for white space: counting and parsing must cut the same numbers.
bool IsSpace(char c) {
  return c == ' ' || (c >= '\t' && c <= '\r');
}

// The bytes of a file from the first number on that begins at or behind a byte, up to the end of
// the file and not of the share: the last record may reach beyond it.
class TailSource final : public FileSource {
 public:
  // Starts one byte early: only the byte before tells whether the one at `begin` begins a number or
  // is inside of one.
  bool OpenAt(const std::string& path, std::int64_t begin) {
    if (!Open(path).ok()) {
      return false;
    }
    if (begin == 0) {
      return true;
    }
    if (fseeko(file_, static_cast<off_t>(begin) - 1, SEEK_SET) != 0) {
      return false;
    }
    // Byte by byte, for a number's length at most; Read goes on from there.
    int c = std::fgetc(file_);
    while (c != EOF && !IsSpace(static_cast<char>(c))) {  // of a number that began before
      c = std::fgetc(file_);
      ++num_skipped_;
    }
    return true;
  }

  /// Bytes of that number.
  std::int64_t num_skipped() const { return num_skipped_; }

 private:
  std::int64_t num_skipped_ = 0;
};

// Numbers are counted through the file, from 0, the three counts of the head included: observations
// begin at 3, cameras where those end, points behind the cameras. token_ is the number that the
// scanner reads next, except that a record is counted when all of it is read: it may then be beyond
// end_.
class ShareReader {
 public:
  ShareReader(const std::string& path, std::unique_ptr<TailSource> source, const BalCounts& counts)
      : scanner_(path, std::move(source)), counts_(counts) {}

  // A section that ends before this share does nothing but return; one that begins behind it finds
  // token_ at end_ already.
  bool Read(std::int64_t first_token, std::int64_t num_tokens, BalShare* share) {
    token_ = first_token;
    end_ = first_token + num_tokens;
    const std::int64_t observations_end = 3 + 4 * counts_.num_observations;
    const std::int64_t cameras_end =
        observations_end + BalProblem::kCameraSize * counts_.num_cameras;
    return SkipTo(3) && ReadObservations(observations_end, share) &&
           ReadBlocks(observations_end, cameras_end, BalProblem::kCameraSize, &share->first_camera,
                      &share->cameras) &&
           ReadBlocks(cameras_end, NumTokens(counts_), BalProblem::kPointSize, &share->first_point,
                      &share->points);
  }

 private:
  // Over what belongs to another share, at most to the end of this one. Words, for what they say is
  // for others to judge.
  bool SkipTo(std::int64_t token) {
    std::string_view word;
    for (; token_ < token && token_ < end_; ++token_) {
      if (!scanner_.ScanWord(&word)) {
        return false;
      }
    }
    return true;
  }

  // To the first record of the section that begins here; its number.
  // The record that token_ is inside of has begun before and is the share's before: rounded up.
  bool SkipToRecord(std::int64_t begin, std::int64_t size, std::int64_t* first) {
    const std::int64_t at = std::max(token_, begin);
    // If the share begins before this section, `at` is the section's begin, and the record its
    // first.
    *first = (at - begin + size - 1) / size;
    return SkipTo(begin + *first * size);
  }

  bool ReadObservations(std::int64_t section_end, BalShare* share) {
    if (token_ >= section_end) {
      return true;
    }
    if (!SkipToRecord(3, 4, &share->first_observation)) {
      return false;
    }
    // Whole records, the last one beyond end_ if it must.
    for (; token_ < std::min(end_, section_end); token_ += 4) {
      BalObservation seen;
      if (!(ReadIndex(counts_.num_cameras, &seen.camera) &&
            ReadIndex(counts_.num_points, &seen.point) && scanner_.ScanDouble(&seen.x) &&
            scanner_.ScanDouble(&seen.y))) {
        return false;
      }
      share->observations.push_back(seen);
    }
    return true;
  }

  bool ReadIndex(std::int64_t count, int* index) {
    std::int64_t value = -1;
    const bool scanned = scanner_.ScanInteger(&value);
    *index = static_cast<int>(value);
    return scanned && value >= 0 && value < count;
  }

  // Cameras or points: records of `size` numbers from the number `begin` on.
  bool ReadBlocks(std::int64_t begin, std::int64_t section_end, std::int64_t size,
                  std::int64_t* first, std::vector<double>* values) {
    if (token_ >= section_end) {
      return true;
    }
    if (!SkipToRecord(begin, size, first)) {
      return false;
    }
    for (; token_ < std::min(end_, section_end); token_ += size) {
      for (std::int64_t k = 0; k < size; ++k) {
        if (!scanner_.ScanDouble(&values->emplace_back())) {
          return false;
        }
      }
    }
    return true;
  }

  TextScanner scanner_;
  const BalCounts counts_;
  std::int64_t token_ = 0;
  std::int64_t end_ = 0;
};

}  // namespace

std::int64_t NumTokens(const BalCounts& counts) {
  return 3 + 4 * counts.num_observations + BalProblem::kCameraSize * counts.num_cameras +
         BalProblem::kPointSize * counts.num_points;
}

// Every process reads the head for itself; it is a few bytes.
bool ReadBalCounts(const std::string& path, BalCounts* counts, std::int64_t* file_bytes) {
  auto source = std::make_unique<FileSource>();
  if (!source->Open(path).ok()) {
    return false;
  }
  *file_bytes = source->file_bytes();
  TextScanner scanner(path, std::move(source));
  for (std::int64_t* count :
       {&counts->num_cameras, &counts->num_points, &counts->num_observations}) {
    if (!scanner.ScanInteger(count) || *count < 1 || *count > INT_MAX) {
      return false;
    }
  }
  return true;
}

// A byte at a time through a buffer, without parsing. A number is counted where it begins: at the
// first byte behind white space.
bool CountTokens(const std::string& path, std::int64_t begin, std::int64_t end,
                 std::int64_t* num_tokens) {
  TailSource source;
  if (!source.OpenAt(path, begin)) {
    return false;
  }
  // Begins behind the number that was cut, with white space before it: `inside` is right.
  std::int64_t at = begin + source.num_skipped();
  std::vector<char> piece(kPiece);
  bool inside = false;
  *num_tokens = 0;
  while (at < end) {
    std::size_t size = 0;
    if (!source.Read(piece.data(), piece.size(), &size).ok()) {
      return false;
    }
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
  return true;
}

// Numbers are checked as in a whole file, so a share that is read is as good as one of ReadBal.
bool ReadBalShare(const std::string& path, const BalCounts& counts, std::int64_t begin,
                  std::int64_t first_token, std::int64_t num_tokens, BalShare* share) {
  auto source = std::make_unique<TailSource>();
  return source->OpenAt(path, begin) &&
         ShareReader(path, std::move(source), counts).Read(first_token, num_tokens, share);
}

}  // namespace inceres::tools
