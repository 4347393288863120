#pragma once

#include <algorithm>

#include "base/aligned_vector.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// Gives the entries above the diagonal the values of those below it.
inline void MirrorLowerTriangle(int size, int stride, double* block) {
  for (int r = 0; r < size; ++r) {
    for (int c = r + 1; c < size; ++c) {
      block[r * stride + c] = block[c * stride + r];
    }
  }
}

/// std::fill with zeros, without a call for blocks of poses.
inline void FillWithZeros(double* data, std::size_t count) {
  switch (count) {
    case 4:
      std::fill_n(data, 4, 0.0);
      return;
    case 12:  // 3 × 3
      std::fill_n(data, 12, 0.0);
      return;
    case 48:  // 6 × 6
      std::fill_n(data, 48, 0.0);
      return;
    default:
      std::fill_n(data, count, 0.0);
  }
}

/// A zeroed padded block for a kernel to sum into: on the stack for the usual sizes, on the heap
/// for frames above 16.
class BlockScratch {
 public:
  /// rows × PadToQuad(columns) zeros.
  double* Zeroed(int rows, int columns) {
    const auto count =
        static_cast<std::size_t>(rows) * static_cast<std::size_t>(PadToQuad(columns));
    double* data = stack_;
    if (count > kInline) {
      heap_.resize(std::max(heap_.size(), count));
      data = heap_.data();
    }
    FillWithZeros(data, count);
    return data;
  }

 private:
  static constexpr std::size_t kInline = 256;
  alignas(64) double stack_[kInline];
  AlignedVector<double> heap_;
};

}  // namespace inceres::internal
