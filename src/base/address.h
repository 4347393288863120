#pragma once

#include <cstddef>
#include <cstdint>

namespace inceres::internal {

/// The address so many entries before `data`, whatever is there: of an array of which only a
/// stretch exists, for who counts from its beginning.
template <typename Entry>
Entry* AddressBefore(std::ptrdiff_t count, Entry* data) {
  constexpr std::uintptr_t kSize = sizeof(Entry);  // NOLINT(bugprone-sizeof-expression): or pointer
  const std::uintptr_t address =
      reinterpret_cast<std::uintptr_t>(data) - static_cast<std::uintptr_t>(count) * kSize;
  return reinterpret_cast<Entry*>(address);  // NOLINT(performance-no-int-to-ptr)
}

}  // namespace inceres::internal
