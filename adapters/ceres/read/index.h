#pragma once

#include <cstddef>
#include <cstdint>

namespace inceres::internal {

// An index kept as a signed number, for a std::vector.
inline std::size_t At(std::int64_t i) {
  return static_cast<std::size_t>(i);
}

}  // namespace inceres::internal
