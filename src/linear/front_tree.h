#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "inceres/linear/block_pattern.h"
#include "inceres/status.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// A dense piece of a sparse factorization: a few consecutive columns of the factor, its pivots, and all rows in which they have
/// entries. What the rows beyond the pivots get from its elimination is its update matrix, which its parent adds to its own.
///
/// In memory a front is column-major: the rows of the pivots, padded to quads, then the others, padded to quads.
struct Front {
  int parent = -1;                           // index of a later front; -1: none, and then it has no rows beyond its pivots
  int child_begin = 0, child_end = 0;        // among FrontTree::children
  int position_begin = 0, position_end = 0;  // its pivots' blocks among FrontTree::order
  int width = 0;                             // pivots
  int height = 0;                            // other rows
  int run_begin = 0, run_end = 0;            // among FrontTree::runs
  int piece_begin = 0, piece_end = 0;        // among FrontTree::pieces

  int below() const { return PadToQuad(width); }  // first row beyond the pivots
  int update_stride() const { return PadToQuad(height); }
  int num_rows() const { return below() + PadToQuad(height); }
  // A power-of-two distance between columns would map them all to the same few cache sets.
  int stride() const { return num_rows() % 128 == 0 ? num_rows() + kQuad : num_rows(); }
  /// Multiplications and additions of its elimination.
  double flops() const {
    const double w = width, h = height;
    return w * (w * (w / 3.0 + h) + h * h);
  }
};

/// Rows of a front's update matrix that are consecutive in its parent, too.
struct FrontRun {
  int from = 0;  // row of the update matrix
  int to = 0;    // row of the parent's front
  int length = 0;
};

/// A block of S in its front. One of its places is a pivot's; a block whose row comes before its column is turned.
struct FrontPiece {
  std::int64_t values = 0;  // where the pattern has it
  int row = 0, column = 0;  // in the front
  int rows = 0, columns = 0;
};

/// The assembly tree of a multifrontal Cholesky factorization of S. Source: Liu, "The Multifrontal Method for Sparse Matrix
/// Solution", SIAM Review 34(1), 1992.
struct FrontTree {
  std::vector<int> order;      // block of S by its place in the order of elimination
  std::vector<Front> fronts;   // children before parents, every subtree in one piece
  std::vector<int> children;   // by front, ascending
  std::vector<FrontRun> runs;  // by front, ascending
  std::vector<FrontPiece> pieces;
  double flops = 0.0;
  double entries = 0.0;  // of the factor
  bool dissected = false;

  std::size_t Bytes() const;
};

/// The tree of FindSymbolicFactor's order and fronts, in scalars. Fails as that does; `may_dissect` is for it.
Status BuildFrontTree(const BlockPattern& pattern, FrontTree* tree, bool may_dissect = true);

}  // namespace inceres::internal
