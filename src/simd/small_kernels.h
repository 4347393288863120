#pragma once

#include <cstdint>

#include "simd/kernels.h"

namespace inceres::internal {

/// What a contribution of a factor goes into: C by `blocks`, as add_outer; y and the squares of the
/// columns, with their peaks, as add_transposed and add_squares.
struct ContributionSums {
  const std::int32_t* blocks = nullptr;
  double* C = nullptr;
  const double* v = nullptr;
  const double* v_out = nullptr;
  double* y = nullptr;
  double* y_peak = nullptr;
  double* squares = nullptr;
  double* squares_peak = nullptr;
};

/// Inner loops of small blocks, such as those of poses, where what is around a product would take
/// longer than the product. As Kernels, one table an instruction set; each gives the bits of those
/// kernels of its set that it stands for.
struct SmallKernels {
  /// Kernels::subtract_outer of B = A's first `cols` rows, on and below the diagonal of C; entries
  /// above it may be anything afterwards.
  void (*subtract_lower_outer)(int rows, int cols, int depth, const double* A, int lda, double* C,
                               int ldc);
  /// What a factor adds: add_outer and add_squares with the sign, add_transposed with the other
  /// one. In one pass where all blocks are those of poses, 3 × 3 or 6 × 6.
  void (*add_contribution)(const Contribution& contribution, double sign,
                           const ContributionSums& sums);
};

/// The table of an instruction set, or null where KernelsFor is.
const SmallKernels* SmallKernelsFor(InstructionSet set);

/// The table that goes with BestKernels.
const SmallKernels& BestSmallKernels();

}  // namespace inceres::internal
