#pragma once

#include <charconv>
#include <cstddef>
#include <string>

#include "inceres/status.h"
#include "io/byte_stream.h"

namespace inceres::internal {

/// Collects text and hands it on in large pieces. The first error stays; Finish() returns it.
class TextWriter {
 public:
  explicit TextWriter(ByteSink* sink) : sink_(sink) { text_.reserve(kFlushSize + 64); }

  /// An int or a double, in the shortest form that reads back as the same value, and what follows
  /// it.
  template <typename Number>
  void Put(Number value, char separator) {
    char digits[40];
    const auto result = std::to_chars(digits, digits + sizeof(digits), value);
    text_.append(digits, result.ptr);
    text_.push_back(separator);
    FlushIfLarge();
  }

  /// Text as it is.
  void PutText(const char* text) {
    text_ += text;
    FlushIfLarge();
  }

  Status Finish() {
    Flush();
    return status_.ok() ? sink_->Finish() : status_;
  }

 private:
  static constexpr std::size_t kFlushSize = std::size_t{1} << 18;

  void FlushIfLarge() {
    if (text_.size() >= kFlushSize) {
      Flush();
    }
  }

  void Flush() {
    if (status_.ok()) {
      status_ = sink_->Write(text_.data(), text_.size());
    }
    text_.clear();
  }

  ByteSink* sink_;
  std::string text_;
  Status status_;
};

}  // namespace inceres::internal
