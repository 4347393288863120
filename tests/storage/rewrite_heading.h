#pragma once

#include <zlib.h>

#include <cstdint>
#include <string>

namespace inceres::test {

/// Where the rest of a saved graph begins.
inline constexpr std::size_t kGraphHeading = 24;

/// Makes size and checksum of a saved graph true again, whatever has been done to the rest: what
/// then is read is anybody's.
inline std::string WithTrueHeading(std::string bytes) {
  const std::size_t size = bytes.size() - kGraphHeading;
  const auto sum = static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data() + kGraphHeading), size));
  for (std::size_t k = 0; k < 8; ++k) {
    bytes[12 + k] = static_cast<char>(static_cast<std::uint64_t>(size) >> (8 * k));
  }
  for (std::size_t k = 0; k < 4; ++k) {
    bytes[20 + k] = static_cast<char>(sum >> (8 * k));
  }
  return bytes;
}

}  // namespace inceres::test
