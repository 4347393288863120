#include "support/allocations.h"

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdlib>

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define INCERES_COUNTS_ALLOCATIONS 1
#endif

namespace inceres::test {
namespace {

std::atomic<std::int64_t> num_allocations{0};
std::atomic<bool> trap{false};

#ifdef INCERES_COUNTS_ALLOCATIONS
void Count() {
  num_allocations.fetch_add(1, std::memory_order_relaxed);
  if (trap.load(std::memory_order_relaxed)) {
    std::abort();
  }
}
#endif

}  // namespace

std::int64_t NumAllocations() {
  return num_allocations.load();
}

AllocationTrap::AllocationTrap() {
  trap = std::getenv("INCERES_TRAP_ALLOCATIONS") != nullptr;
}

AllocationTrap::~AllocationTrap() {
  trap = false;
}

bool CanCountAllocations() {
#ifdef INCERES_COUNTS_ALLOCATIONS
  return true;
#else
  return false;
#endif
}

}  // namespace inceres::test

#ifdef INCERES_COUNTS_ALLOCATIONS
// The names under which glibc keeps its own when a program brings others.
extern "C" {
void* __libc_malloc(std::size_t size);                     // NOLINT(bugprone-reserved-identifier)
void* __libc_calloc(std::size_t count, std::size_t size);  // NOLINT(bugprone-reserved-identifier)
void* __libc_realloc(void* memory, std::size_t size);      // NOLINT(bugprone-reserved-identifier)
void* __libc_memalign(std::size_t alignment,
                      std::size_t size);  // NOLINT(bugprone-reserved-identifier)

void* malloc(std::size_t size) {
  inceres::test::Count();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  inceres::test::Count();
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  inceres::test::Count();
  return __libc_realloc(memory, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  inceres::test::Count();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  inceres::test::Count();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  inceres::test::Count();
  *memory = __libc_memalign(alignment, size);
  return *memory != nullptr ? 0 : ENOMEM;
}
}
#endif
