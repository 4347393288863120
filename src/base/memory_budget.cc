#include "base/memory_budget.h"

#include <cmath>
#include <cstdio>
#include <limits>

namespace inceres::internal {

// Memory of a solve, predicted part by part while it is set up, so that a plan that does not fit
// ends with a message that says what it would take, and not as a bad_alloc when half of it is done.
// The limit is the user's, or else what the system says is left; that is asked once, and only by a
// plan that is large, since asking takes longer than a small solve.

// Rounded up below a gibibyte, so that something never reads as 0 MiB.
std::string FormatBytes(double bytes) {
  constexpr double kMiB = 1048576.0;
  char text[32];
  if (bytes < 1024.0 * kMiB) {
    std::snprintf(text, sizeof(text), "%.0f MiB", std::ceil(bytes / kMiB));
  } else {
    std::snprintf(text, sizeof(text), "%.1f GiB", bytes / (1024.0 * kMiB));
  }
  return text;
}

namespace {

// Arrays as large begin at a huge page (base/aligned_vector.h): there is room to find one.
std::int64_t WithAlignment(std::int64_t bytes) {
  constexpr std::int64_t kHugePage = std::int64_t{1} << 21;
  return bytes >= 2 * kHugePage ? bytes + kHugePage : bytes;
}

}  // namespace

// Infinite until the system has been asked.
MemoryBudget::MemoryBudget(std::int64_t limit, AvailableMemory available)
    : limit_(limit > 0 ? static_cast<double>(limit) : std::numeric_limits<double>::infinity()),
      is_asked_for_(limit > 0),
      // With a limit of the user's it never is.
      available_(limit > 0 ? nullptr : std::move(available)) {
}

bool MemoryBudget::HasRoomFor(std::int64_t bytes) {
  // What is left is on top of what this budget has counted so far.
  if (available_ != nullptr && taken_ + bytes > kUnasked) {
    limit_ = static_cast<double>(taken_) + available_();
    available_ = nullptr;
  }
  // As doubles, for the limit may be infinite.
  return static_cast<double>(taken_ + bytes) <= limit_;
}

void MemoryBudget::Take(std::int64_t bytes, const char* what) {
  const bool fits = HasRoomFor(WithAlignment(bytes));
  // Counted before it throws, for the message says what it takes together.
  taken_ += WithAlignment(bytes);
  if (!fits) {
    throw MemoryExceeded("The solve does not fit into memory: with " + std::string(what) + " (" +
                         FormatBytes(static_cast<double>(bytes)) + ") it takes " +
                         FormatBytes(static_cast<double>(taken_)) + " or more, and " +
                         (is_asked_for_ ? "max_memory_bytes is " : "there are ") +
                         FormatBytes(limit_) + (is_asked_for_ ? "." : " left."));
  }
}

// Indices have 32 bits: what does not fit into them would wrap around, whatever memory there is.
void MemoryBudget::CheckCount(std::int64_t count, std::int64_t limit, const char* what) {
  if (count >= limit) {
    throw MemoryExceeded("The problem is too large: " + std::to_string(count) + " " + what +
                         ", less than " + std::to_string(limit) + " can be numbered.");
  }
}

}  // namespace inceres::internal
