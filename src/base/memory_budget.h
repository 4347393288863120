#pragma once

#include <cstdint>
#include <new>
#include <string>
#include <utility>

#include "base/available_memory.h"

namespace inceres::internal {

/// "12.3 GiB", "45 MiB".
INCERES_EXPORT std::string FormatBytes(double bytes);

/// A plan that does not fit: what was counted up to where the budget was exceeded. A bad_alloc,
/// since it comes in place of one; whoever catches that for a solve tells what this says.
class MemoryExceeded : public std::bad_alloc {
 public:
  explicit MemoryExceeded(std::string message) : message_(std::move(message)) {}
  const char* what() const noexcept override { return message_.c_str(); }
  const std::string& message() const { return message_; }

 private:
  std::string message_;
};

/// Counts what the parts of a solve are going to take, each before it does, while the solve is set
/// up: one that does not fit ends there, and not when half of it is done. What is given back on the
/// way serves the parts that follow.
class MemoryBudget {
 public:
  /// `limit` 0: what `available` says when more than kUnasked bytes are to be taken; asking takes
  /// longer than a small solve.
  explicit MemoryBudget(std::int64_t limit, AvailableMemory available = AvailableBytes);

  /// Whether so many bytes more are not too many.
  bool HasRoomFor(std::int64_t bytes);
  /// Throws MemoryExceeded, with `what`, where they are.
  void Take(std::int64_t bytes, const char* what);
  /// What was taken and is there no more.
  void GiveBack(std::int64_t bytes) { taken_ -= bytes; }
  /// Throws it where a count that 32 bits hold is to be this, below `limit`.
  static void CheckCount(std::int64_t count, std::int64_t limit, const char* what);

  std::int64_t taken() const { return taken_; }

  static constexpr std::int64_t kUnasked = std::int64_t{1} << 28;  // 256 MiB

 private:
  double limit_;
  const bool is_asked_for_;
  AvailableMemory available_;  // until it has been asked
  std::int64_t taken_ = 0;
};

}  // namespace inceres::internal
