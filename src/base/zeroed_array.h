#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>

#include "base/aligned_vector.h"

namespace inceres::internal {

/// Zeros that cost nothing until they are touched: what is as large as all Jacobians comes from the
/// system as zero pages, and the threads that write it first share the work of providing them.
/// Aligned as an AlignedVector; of a size once and for all.
class ZeroedArray {
 public:
  ZeroedArray() = default;
  explicit ZeroedArray(std::size_t size) : ZeroedArray(size, std::calloc(1, Bytes(size))) {}
  /// With anything in it, for who writes all that he reads.
  static ZeroedArray Unwritten(std::size_t size) {
    return ZeroedArray(size, std::malloc(Bytes(size)));
  }

  double* data() const { return data_; }
  std::size_t size() const { return size_; }
  const double* begin() const { return data_; }
  const double* end() const { return data_ + size_; }

  friend bool operator==(const ZeroedArray& a, const ZeroedArray& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end());
  }

 private:
  struct Free {
    void operator()(void* memory) const { std::free(memory); }
  };
  using Allocator = CacheLineAllocator<double>;

  static std::size_t Alignment(std::size_t size) {
    return static_cast<std::size_t>(Allocator::Alignment(size));
  }
  // Enough to align it.
  static std::size_t Bytes(std::size_t size) { return size * sizeof(double) + Alignment(size); }

  ZeroedArray(std::size_t size, void* memory) : memory_(memory), size_(size) {
    if (memory == nullptr) {
      throw std::bad_alloc();
    }
    std::size_t room = Bytes(size);
    data_ = static_cast<double*>(std::align(Alignment(size), size * sizeof(double), memory, room));
    Allocator::AskForHugePages(data_, size);
  }

  std::unique_ptr<void, Free> memory_;
  double* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace inceres::internal
