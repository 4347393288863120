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
  explicit ZeroedArray(std::size_t size) : size_(size) {
    using Allocator = CacheLineAllocator<double>;
    const auto alignment = static_cast<std::size_t>(Allocator::Alignment(size));
    memory_.reset(std::calloc(size * sizeof(double) + alignment, 1));
    if (memory_ == nullptr) {
      throw std::bad_alloc();
    }
    void* aligned = memory_.get();
    std::size_t room = size * sizeof(double) + alignment;
    data_ = static_cast<double*>(std::align(alignment, size * sizeof(double), aligned, room));
    Allocator::AskForHugePages(data_, size);
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
  std::unique_ptr<void, Free> memory_;
  double* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace inceres::internal
