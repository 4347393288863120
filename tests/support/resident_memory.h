#pragma once

#include <unistd.h>

#include <fstream>

namespace inceres::test {

// A sanitizer keeps what was freed, and forks badly once threads run.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kUnderSanitizer = true;
#else
inline constexpr bool kUnderSanitizer = false;
#endif

/// Bytes of this process that are in memory; negative where the system does not tell.
inline long ResidentBytes() {
  long total = 0, resident = -1;
  std::ifstream("/proc/self/statm") >> total >> resident;
  return resident < 0 ? -1 : resident * sysconf(_SC_PAGESIZE);
}

}  // namespace inceres::test
