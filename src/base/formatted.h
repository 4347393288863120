#pragma once

#include <cstdarg>
#include <cstdio>
#include <string>

namespace inceres::internal {

/// What printf would print, at most 511 bytes of it, for a report that is put together once a
/// solve.
[[gnu::format(printf, 1, 2)]] inline std::string Formatted(const char* format, ...) {
  char text[512];
  std::va_list arguments;
  va_start(arguments, format);
  const int length = std::vsnprintf(text, sizeof(text), format, arguments);
  va_end(arguments);
  return length < 0 ? std::string() : std::string(text);
}

}  // namespace inceres::internal
