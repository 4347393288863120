#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "inceres/status.h"
#include "io/byte_stream.h"

namespace inceres::internal {

/// Splits a text file into numbers and words, fast: a buffer of fixed size, refilled so that no
/// token ever lies across its end, and std::from_chars on the bytes in place. Nothing is formatted
/// until something is wrong.
///
/// A Scan function that returns false leaves behind what went wrong; Failure(field) makes the
/// message of it.
class TextScanner {
 public:
  TextScanner(std::string path, std::unique_ptr<ByteSource> source);

  /// One decimal integer that fits into 64 bits; a leading '+' is accepted.
  bool ScanInteger(std::int64_t* value);
  /// One finite decimal number; a leading '+' is accepted, what is too small for a double is 0.
  bool ScanDouble(double* value);
  /// One word, valid until the next call.
  bool ScanWord(std::string_view* word);

  /// From now on a token must be on the current line: Scan functions fail at the end of the line.
  void StayInLine() { in_line_ = true; }
  /// Skips the rest of the line.
  void SkipLine();
  /// Lets Scan functions cross line ends again.
  void LeaveLine() { in_line_ = false; }

  /// True if only white space follows (in this line after StayInLine(), in the file otherwise).
  /// False also where reading has failed before that end was seen: Failure() then tells why.
  bool AtEnd();

  std::int64_t line() const { return line_; }
  const std::string& path() const { return path_; }

  /// kIo: `file:line: field: what was wrong with the last token`.
  Status Failure(const std::string& field) const;
  /// kIo: `file:line: what`, for a token that scanned well but is not acceptable.
  Status FailureAt(std::int64_t line, const std::string& what) const;

 private:
  enum class Problem {
    kNone,
    kEndOfFile,
    kEndOfLine,
    kNotInteger,
    kNotNumber,
    kNotFinite,
    kTooLarge,
    kUnexpected
  };

  bool SkipSpace();
  bool Refill();
  bool Reject(Problem problem);
  const char* TokenLimit() const;
  bool IsTokenEnd(const char* position) const;
  const char* SkipPlus() const;

  std::string path_;
  std::unique_ptr<ByteSource> source_;
  std::vector<char> buffer_;
  const char* position_;
  const char* end_;
  bool source_ended_ = false;
  bool in_line_ = false;
  std::int64_t line_ = 1;
  Problem problem_ = Problem::kNone;
  Status source_status_;  // why reading stopped, if not at the end; good bytes may be unread then
};

/// A word of a file as messages show it: its first 40 characters, '?' for what cannot be printed.
std::string Shown(std::string_view word);

}  // namespace inceres::internal
