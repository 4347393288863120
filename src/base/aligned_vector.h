#pragma once

#include <cstddef>
#include <memory>
#include <new>
#include <utility>
#include <vector>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace inceres::internal {

/// Allocates on cache-line boundaries, so that no vector register load of a padded row crosses two
/// lines. What takes several huge pages asks for them: the first touch of a page and the search for
/// its address then cost a fraction, and blocks that lie apart, as those of Y, are found sooner.
template <typename T>
struct CacheLineAllocator {
  using value_type = T;
  static constexpr std::size_t kCacheLine = 64;
  static constexpr std::size_t kHugePage = std::size_t{1} << 21;

  CacheLineAllocator() = default;
  template <typename U>
  // NOLINTNEXTLINE(google-explicit-constructor): allocators convert
  CacheLineAllocator(const CacheLineAllocator<U>&) {}

  T* allocate(std::size_t count) {
    void* memory = ::operator new(count * sizeof(T), Alignment(count));
    AskForHugePages(memory, count);
    return static_cast<T*>(memory);
  }
  void deallocate(T* pointer, std::size_t count) { ::operator delete(pointer, Alignment(count)); }

  /// A wish: where it is not granted nothing changes. The last page may be mostly empty and stays a
  /// small one.
  static void AskForHugePages([[maybe_unused]] void* memory, [[maybe_unused]] std::size_t count) {
#ifdef __linux__
    if (IsLarge(count)) {
      madvise(memory, count * sizeof(T) / kHugePage * kHugePage, MADV_HUGEPAGE);
    }
#endif
  }

  static bool IsLarge(std::size_t count) {
    return count * sizeof(T) >= 2 * kHugePage;
  }
  static std::align_val_t Alignment(std::size_t count) {
    return std::align_val_t{IsLarge(count) ? kHugePage : kCacheLine};
  }

  friend bool operator==(const CacheLineAllocator&, const CacheLineAllocator&) {
    return true;
  }
  friend bool operator!=(const CacheLineAllocator&, const CacheLineAllocator&) {
    return false;
  }
};

template <typename T>
using AlignedVector = std::vector<T, CacheLineAllocator<T>>;

/// Allocates what grows without a value: nothing is written, and no page asked of the system, until
/// somebody does, such as several threads at once.
template <typename T>
struct UnwrittenAllocator : std::allocator<T> {
  UnwrittenAllocator() = default;
  template <typename U>
  // NOLINTNEXTLINE(google-explicit-constructor): allocators convert
  UnwrittenAllocator(const UnwrittenAllocator<U>&) {}

  // NOLINTBEGIN(readability-identifier-naming): the standard's names
  template <typename U>
  struct rebind {
    using other = UnwrittenAllocator<U>;
  };
  // NOLINTEND(readability-identifier-naming)
  template <typename U, typename... Arguments>
  void construct(U* place, Arguments&&... arguments) {
    if constexpr (sizeof...(Arguments) == 0) {
      ::new (static_cast<void*>(place)) U;
    } else {
      ::new (static_cast<void*>(place)) U(std::forward<Arguments>(arguments)...);
    }
  }
};

/// For who writes all that he reads. Of plain numbers and structures of these.
template <typename T>
using UnwrittenVector = std::vector<T, UnwrittenAllocator<T>>;

}  // namespace inceres::internal
