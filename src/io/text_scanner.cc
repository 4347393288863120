#include "io/text_scanner.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <utility>

// The scanner that all text formats are read with. Bytes stand in one buffer between position_ and
// end_; before a token is looked at, SkipSpace sees to it that at least kMaxToken bytes of it
// follow, or all that the file has left. So a token is always whole and in one piece,
// std::from_chars can run on it in place, and no function has to think of the end of a piece.
//
// std::from_chars depends on no locale and rounds to the nearest double. What it takes and the
// formats do not ("inf", "nan"), and what they take and it does not (a leading '+', numbers too
// small for a double), is put right here.
//
// A failed scan leaves position_ at the token and the reason in problem_, from which Failure makes
// the message: scanning well costs no string.

namespace inceres::internal {
namespace {

constexpr std::size_t kBufferSize = std::size_t{1} << 18;  // stays in the second-level cache
constexpr std::ptrdiff_t kMaxToken = 512;                  // longer than any sensible number
constexpr std::size_t kMaxShown = 40;

bool IsLineEnd(char c) {
  return c == '\n' || c == '\r';
}
bool IsBlank(char c) {
  return c == ' ' || c == '\t' || c == '\v' || c == '\f';
}
bool IsSpace(char c) {
  return IsBlank(c) || IsLineEnd(c);
}

// Whether a number beyond the range of double is too small rather than too large: 1e-400, or
// 0.000...01. Absurdly long ones with an exponent count as too large, which is an error rather than
// a wrong value.
// The question comes up because from_chars reports both with one error.
bool IsUnderflow(const char* first, const char* last) {
  const char* exponent = std::find_if(first, last, [](char c) { return c == 'e' || c == 'E'; });
  if (exponent != last) {
    // Fewer than 300 digits with a negative exponent cannot make a number beyond 1e308.
    return exponent[1] == '-' && last - first < 300;
  }
  // Without one it is the digits before the point that make a number large.
  const char* point = std::find(first, last, '.');
  return std::all_of(first + (*first == '-' ? 1 : 0), point, [](char c) { return c == '0'; });
}

}  // namespace

// ASCII only: a binary file read by mistake must not get at the terminal.
std::string Shown(std::string_view word) {
  std::string shown(word.substr(0, kMaxShown));
  std::replace_if(
      shown.begin(), shown.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return shown;
}

// One byte more than is ever filled: for the zero behind the last one.
TextScanner::TextScanner(std::string path, std::unique_ptr<ByteSource> source)
    : path_(std::move(path)), source_(std::move(source)), buffer_(kBufferSize + 1) {
  position_ = end_ = buffer_.data();
}

// Moves what is unread to the front and fills the rest. False if nothing new came.
// The move is short: fewer than kMaxToken bytes are unread when SkipSpace calls.
bool TextScanner::Refill() {
  const std::size_t unread = static_cast<std::size_t>(end_ - position_);
  std::memmove(buffer_.data(), position_, unread);
  position_ = buffer_.data();
  std::size_t filled = unread;
  // A source may give less than was asked for without being at its end; after an error it is not
  // asked again.
  while (!source_ended_ && filled < kBufferSize) {
    std::size_t size = 0;
    source_status_ = source_->Read(buffer_.data() + filled, kBufferSize - filled, &size);
    source_ended_ = !source_status_.ok() || size == 0;
    filled += size;
  }
  end_ = buffer_.data() + filled;
  buffer_[filled] = '\0';  // a line end may be looked at one byte ahead
  return filled > unread;
}

// Moves to the start of the next token and makes sure that all of it is in the buffer. False at the
// end of the file, or of the line.
bool TextScanner::SkipSpace() {
  for (;;) {
    while (position_ != end_ && IsBlank(*position_)) {
      ++position_;
    }
    // Blanks may have been all there was: the loop goes on with what has come.
    if (end_ - position_ < kMaxToken && !source_ended_) {
      Refill();
      continue;
    }
    if (position_ == end_) {
      problem_ = Problem::kEndOfFile;
      return false;
    }
    if (!IsLineEnd(*position_)) {
      return true;
    }
    // The line end stays unread, and line_ the line of the record, until LeaveLine.
    if (in_line_) {
      problem_ = Problem::kEndOfLine;
      return false;
    }
    // LF, CR LF and CR all end one line.
    // A CR that an LF follows is not counted: that LF will be.
    line_ += *position_ == '\n' || position_[1] != '\n';
    ++position_;
  }
}

bool TextScanner::AtEnd() {
  if (SkipSpace()) {
    problem_ = Problem::kUnexpected;
    return false;
  }
  // A file that cannot be read further has not ended: the caller's Failure then tells the source's
  // error. A line whose end was read has, whatever follows it.
  return problem_ == Problem::kEndOfLine || source_status_.ok();
}

// Token by token, so that comments longer than the buffer are fine.
void TextScanner::SkipLine() {
  in_line_ = true;
  while (SkipSpace()) {
    while (position_ != end_ && !IsSpace(*position_)) {
      ++position_;
    }
  }
  in_line_ = false;
}

bool TextScanner::Reject(Problem problem) {
  problem_ = problem;
  return false;
}

// A longer token counts as ending here, where no white space follows: numbers of that length are
// refused.
const char* TextScanner::TokenLimit() const {
  return position_ + std::min(kMaxToken, end_ - position_);
}

// Where a file cannot be read further, a token may be the first half of one: Failure then tells the
// source's error.
bool TextScanner::IsTokenEnd(const char* position) const {
  return position == end_ ? source_status_.ok() : IsSpace(*position);
}

// std::from_chars does not know '+'.
// Only one sign: "+-1" is no number.
const char* TextScanner::SkipPlus() const {
  const bool skip =
      *position_ == '+' && position_ + 1 != end_ && position_[1] != '-' && position_[1] != '+';
  return skip ? position_ + 1 : position_;
}

// All of the token has to be the number: "12x" and "1.5" are no integers. The token is left unread
// where it is refused, for the message.
bool TextScanner::ScanInteger(std::int64_t* value) {
  if (!SkipSpace()) {
    return false;
  }
  const auto [next, error] = std::from_chars(SkipPlus(), TokenLimit(), *value);
  if (error == std::errc::invalid_argument || !IsTokenEnd(next)) {
    return Reject(Problem::kNotInteger);
  }
  if (error != std::errc()) {
    return Reject(Problem::kTooLarge);
  }
  position_ = next;
  return true;
}

// As ScanInteger, with the two cases that from_chars treats as numbers: one too small for a double
// becomes a zero of its sign, and infinity and NaN, in letters, are refused.
bool TextScanner::ScanDouble(double* value) {
  if (!SkipSpace()) {
    return false;
  }
  const char* first = SkipPlus();
  const auto [next, error] = std::from_chars(first, TokenLimit(), *value);
  if (error == std::errc::invalid_argument || !IsTokenEnd(next)) {
    return Reject(Problem::kNotNumber);
  }
  if (error == std::errc::result_out_of_range) {
    if (!IsUnderflow(first, next)) {
      return Reject(Problem::kTooLarge);
    }
    *value = *first == '-' ? -0.0 : 0.0;
  } else if (!std::isfinite(*value)) {
    return Reject(Problem::kNotFinite);
  }
  position_ = next;
  return true;
}

bool TextScanner::ScanWord(std::string_view* word) {
  if (!SkipSpace()) {
    return false;
  }
  const char* next = std::find_if(position_, TokenLimit(), IsSpace);
  if (next == end_ && !source_status_.ok()) {
    return Reject(Problem::kEndOfFile);
  }
  *word = std::string_view(position_, static_cast<std::size_t>(next - position_));
  position_ = next;
  return true;
}

Status TextScanner::FailureAt(std::int64_t line, const std::string& what) const {
  return Status::Error(StatusCode::kIo, path_ + ":" + std::to_string(line) + ": " + what);
}

// For the token that position_ is at.
Status TextScanner::Failure(const std::string& field) const {
  const char* token_end = std::find_if(position_, end_, IsSpace);
  if (!source_status_.ok() && token_end == end_) {  // the token may have been cut off
    return FailureAt(line_, field + ": " + source_status_.message);
  }
  // A token at the very end of the file, without a line end, may be the first half of a number: the
  // message says so.
  const char* cut_off =
      source_ended_ && token_end == end_ && position_ != end_ ? ", the file ends here" : "";
  const std::string token =
      Shown(std::string_view(position_, static_cast<std::size_t>(token_end - position_)));
  switch (problem_) {
    case Problem::kEndOfFile:
      return FailureAt(line_, field + ": missing, the file ends here");
    case Problem::kEndOfLine:
      return FailureAt(line_, field + ": missing, the line ends here");
    case Problem::kNotInteger:
      return FailureAt(line_, field + ": '" + token + "' is not an integer" + cut_off);
    case Problem::kNotNumber:
      return FailureAt(line_, field + ": '" + token + "' is not a number" + cut_off);
    case Problem::kNotFinite:
      return FailureAt(line_, field + ": '" + token + "' is not a finite number");
    case Problem::kTooLarge:
      return FailureAt(line_, field + ": '" + token + "' is too large");
    case Problem::kUnexpected:
      return FailureAt(line_, field + ": unexpected '" + token + "'");
    case Problem::kNone:
      break;
  }
  return FailureAt(line_, field + ": not acceptable");
}

}  // namespace inceres::internal
