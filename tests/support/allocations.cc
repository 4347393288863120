#include "support/allocations.h"

#include <malloc.h>

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
std::atomic<std::int64_t> bytes_in_use{0};
std::atomic<std::int64_t> peak_bytes{0};
std::atomic<bool> trap{false};

#ifdef INCERES_COUNTS_ALLOCATIONS
void Count() {
  num_allocations.fetch_add(1, std::memory_order_relaxed);
  if (trap.load(std::memory_order_relaxed)) {
    std::abort();
  }
}

// What an allocation has returned, or null.
void* Note(void* memory) {
  const auto size = static_cast<std::int64_t>(malloc_usable_size(memory));
  const std::int64_t bytes = bytes_in_use.fetch_add(size, std::memory_order_relaxed) + size;
  std::int64_t peak = peak_bytes.load(std::memory_order_relaxed);
  while (bytes > peak && !peak_bytes.compare_exchange_weak(peak, bytes)) {
  }
  return memory;
}

void NoteFreed(std::size_t size) {
  bytes_in_use.fetch_sub(static_cast<std::int64_t>(size), std::memory_order_relaxed);
}
#endif

}  // namespace

std::int64_t NumAllocations() {
  return num_allocations.load();
}

std::int64_t BytesInUse() {
  return bytes_in_use.load();
}

std::int64_t PeakBytes() {
  return peak_bytes.load();
}

void StartPeak() {
  peak_bytes = bytes_in_use.load();
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
void __libc_free(void* memory);           // NOLINT(bugprone-reserved-identifier)

void* malloc(std::size_t size) {
  inceres::test::Count();
  return inceres::test::Note(__libc_malloc(size));
}
void* calloc(std::size_t count, std::size_t size) {
  inceres::test::Count();
  return inceres::test::Note(__libc_calloc(count, size));
}
void* realloc(void* memory, std::size_t size) {
  inceres::test::Count();
  const std::size_t before = malloc_usable_size(memory);
  void* const after = __libc_realloc(memory, size);
  if (after != nullptr || size == 0) {
    inceres::test::NoteFreed(before);
    inceres::test::Note(after);
  }
  return after;
}
void* memalign(std::size_t alignment, std::size_t size) {
  inceres::test::Count();
  return inceres::test::Note(__libc_memalign(alignment, size));
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  inceres::test::Count();
  return inceres::test::Note(__libc_memalign(alignment, size));
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  inceres::test::Count();
  *memory = inceres::test::Note(__libc_memalign(alignment, size));
  return *memory != nullptr ? 0 : ENOMEM;
}
void free(void* memory) {
  inceres::test::NoteFreed(malloc_usable_size(memory));
  __libc_free(memory);
}
}
#endif
