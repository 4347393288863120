#include "base/memory_budget.h"

#include <cmath>
#include <cstdio>
#include <limits>

namespace inceres::internal {

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

MemoryBudget::MemoryBudget(std::int64_t limit, AvailableMemory available)
    : limit_(limit > 0 ? static_cast<double>(limit) : std::numeric_limits<double>::infinity()),
      is_asked_for_(limit > 0),
      available_(limit > 0 ? nullptr : std::move(available)) {
}

bool MemoryBudget::HasRoomFor(std::int64_t bytes) {
  if (available_ != nullptr && taken_ + bytes > kUnasked) {
    limit_ = static_cast<double>(taken_) + available_();
    available_ = nullptr;
  }
  return static_cast<double>(taken_ + bytes) <= limit_;
}

void MemoryBudget::Take(std::int64_t bytes, const char* what) {
  const bool fits = HasRoomFor(bytes);
  taken_ += bytes;
  if (!fits) {
    throw MemoryExceeded("The solve does not fit into memory: with " + std::string(what) + " (" +
                         FormatBytes(static_cast<double>(bytes)) + ") it takes " +
                         FormatBytes(static_cast<double>(taken_)) + " or more, and " +
                         (is_asked_for_ ? "max_memory_bytes is " : "there are ") +
                         FormatBytes(limit_) + (is_asked_for_ ? "." : " left."));
  }
}

void MemoryBudget::CheckCount(std::int64_t count, std::int64_t limit, const char* what) {
  if (count >= limit) {
    throw MemoryExceeded("The problem is too large: " + std::to_string(count) + " " + what +
                         ", less than " + std::to_string(limit) + " can be numbered.");
  }
}

}  // namespace inceres::internal
