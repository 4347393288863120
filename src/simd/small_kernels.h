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

/// Where terms of a kind lie: A_p at a + 4 term.a, B_p at b + 4 term.b, v_p at v + term.v.
struct SmallSource {
  const double* a = nullptr;
  const double* b = nullptr;
  const double* v = nullptr;
};

/// One product B_pᵀA_p, and A_pᵀv_p with it. Terms of a segment are summed by themselves, and then
/// added.
struct SmallTerm {
  std::int32_t a;
  std::int32_t b;
  std::int32_t v;
  std::int16_t source;
  bool ends_segment;
};

/// C = Σ_p B_pᵀA_p over the terms of a block, and of one on the diagonal y = Σ_p A_pᵀv_p, with A_p
/// and B_p of `depth` rows, 3 or 6, and 3 columns, padded to quads.
struct SmallBlock {
  std::int64_t C = 0;  ///< where it begins
  std::int32_t first_term = 0;
  std::int32_t num_terms = 0;  ///< 0: it is not one of these
  std::int32_t y = -1;         ///< where its three entries begin; -1: it is not on the diagonal
};
struct SmallProducts {
  const SmallSource* sources = nullptr;
  const SmallTerm* terms = nullptr;
  int depth = 0;
};

/// A block row of an envelope factor. Offsets of block columns are given beside it.
struct EnvelopeRow {
  double* values = nullptr;          ///< from scalar column `start`, a whole quad, on
  double* inverse_pivots = nullptr;  ///< of its block on the diagonal
  int first_column = 0;              ///< block
  bool held = false;                 ///< a row of the identity
  int start = 0;
  int stride = 0;  ///< between scalar rows: whole quads
};

/// Largest block of a path of tiles.
constexpr int kMostTileScalars = 8;

/// Inner loops of small blocks, such as those of poses, where what is around a product would take
/// longer than the product. As Kernels, one table an instruction set; each gives the bits of those
/// kernels of its set that it stands for.
struct SmallKernels {
  /// Kernels::subtract_outer of B = A's first `cols` rows, on and below the diagonal of C; entries
  /// above it may be anything afterwards.
  void (*subtract_lower_outer)(int rows, int cols, int depth, const double* A, int lda, double* C,
                               int ldc);
  /// Zeros, of whole quads.
  void (*set_zero)(std::int64_t count, double* A);
  /// C += A, both column-major: nothing between the columns is written.
  void (*add_columns)(int rows, int cols, const double* A, int lda, double* C, int ldc);
  /// What a factor adds: add_outer and add_squares with the sign, add_transposed with the other
  /// one. In one pass where all blocks are those of poses, 3 × 3 or 6 × 6.
  void (*add_contribution)(const Contribution& contribution, double sign,
                           const ContributionSums& sums);
  /// Blocks one after the other, C without padding, written and not added to: what
  /// accumulate_products and accumulate_vectors would make of zeros; and the diagonal of C, where y
  /// goes.
  void (*sum_products_of_three)(const SmallProducts& products, const SmallBlock* blocks, int count,
                                double* C, double* y, double* diagonal);

  /// L Lᵀ of a path of blocks of `size` ≤ kMostTileScalars, each coupled to the next one and, once
  /// those before it are eliminated, to one more, the anchor. A tile has the columns of a block: a
  /// section of padded `size` rows for the block itself, one for the anchor, one for the next
  /// block; they follow each other. Behind the last there is one more, of what comes after the
  /// path: its own section and the anchor's lose what the path contributes there; and so does the
  /// anchor's own block, one section a column, unless it is null. In L's own blocks the diagonal
  /// has reciprocals, and above it is anything. The scalar that is not positive and finite; -1:
  /// none.
  int (*eliminate_path)(int size, int count, double* tiles, double* anchor_square);
  /// y := L⁻¹ y of a path, one section a block; the section behind them, and the anchor's, lose
  /// what it contributes to them. Padding is zero.
  void (*solve_path_forward)(int size, int count, const double* tiles, double* y, double* anchor);
  /// y := L⁻ᵀ y, where the section behind the path and the anchor's have their solution already.
  void (*solve_path_backward)(int size, int count, const double* tiles, const double* anchor,
                              double* y);

  /// Blocks [first, end) of row i of an envelope factor, all of them and the row of `size`, 3, 6 or
  /// 9: L_ij = (A_ij − Σ L_ik L_jkᵀ) L_jj⁻ᵀ; and where end = i the block on the diagonal, A_ii − Σ
  /// L_ik L_ikᵀ. Those before `first` are solved.
  void (*solve_envelope_run)(int size, const EnvelopeRow* rows, const int* offsets, int i,
                             int first, int end);
};

/// The table of an instruction set, or null where KernelsFor is.
const SmallKernels* SmallKernelsFor(InstructionSet set);

/// The table that goes with BestKernels.
const SmallKernels& BestSmallKernels();

}  // namespace inceres::internal
