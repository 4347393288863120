#pragma once

#include <algorithm>
#include <cstddef>
#include <type_traits>

#include "simd/kernels.h"

namespace inceres::internal {

/// Copies a padded block to where its rows are `stride` apart. Those of points and poses are copied
/// without a call.
template <typename Columns>
void PackRows(int rows, Columns columns, const double* padded, double* packed,
              std::ptrdiff_t stride) {
  for (int r = 0; r < rows; ++r) {
    std::copy_n(padded + r * PadToQuad(columns), int{columns}, packed + r * stride);
  }
}
inline void PackBlock(int rows, int columns, const double* padded, double* packed,
                      std::ptrdiff_t stride) {
  switch (columns) {
    case 3:
      return PackRows(rows, std::integral_constant<int, 3>(), padded, packed, stride);
    case 6:
      return PackRows(rows, std::integral_constant<int, 6>(), padded, packed, stride);
    default:
      return PackRows(rows, columns, padded, packed, stride);
  }
}

}  // namespace inceres::internal
