#pragma once

#include <cstdint>

namespace inceres::test {

/// How often memory was asked for so far, by whoever in the program: operator new, malloc,
/// libraries, all threads. A test program that links inceres_allocations counts. Environment
/// INCERES_TRAP_ALLOCATIONS: abort() at the first one inside AllocationTrap, for a debugger to
/// show.
std::int64_t NumAllocations();

/// Bytes that are in use now, and the most that were since StartPeak.
std::int64_t BytesInUse();
std::int64_t PeakBytes();
void StartPeak();

/// False where nothing can be counted: a sanitizer has its own allocator, or the C library is not
/// glibc.
bool CanCountAllocations();

/// While one lives, allocations trap if the environment asks for it.
class AllocationTrap {
 public:
  AllocationTrap();
  ~AllocationTrap();
  AllocationTrap(const AllocationTrap&) = delete;
  AllocationTrap& operator=(const AllocationTrap&) = delete;
};

}  // namespace inceres::test
