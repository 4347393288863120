#pragma once

#include <cstddef>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "inceres/status.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// A dense piece of a sparse factorization: a few consecutive columns of the factor, its pivots,
/// and all rows in which they have entries. What the rows beyond the pivots get from its
/// elimination is its update matrix, which its parent adds to its own.
///
/// In memory a front is column-major: the rows of the pivots, padded to quads, then the others,
/// padded to quads.
struct Front {
  int parent = -1;  // index of a later front; -1: none, and then it has no rows beyond its pivots
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

/// A block of S in its front. One of its places is a pivot's; a block whose row comes before its
/// column is turned.
struct FrontPiece {
  int i = 0, block = 0;     // its row and its index in the pattern
  int row = 0, column = 0;  // in the front
};

/// Fronts that one task takes one after the other, once those of the segments before it are done.
struct FrontSegment {
  std::vector<int> fronts;  // ascending
  std::vector<int> before;  // other segments, independent of each other
};

/// The assembly tree of a multifrontal Cholesky factorization of S, its tasks, and where each front
/// is kept. Update matrices that do not wait for their parents at the same time share memory. A
/// parent that is smaller than what would wait for it takes each as it comes: a few points seen by
/// a thousand cameras are one front with a thousand children. Source: Liu, "The Multifrontal Method
/// for Sparse Matrix Solution", SIAM Review 34(1), 1992.
struct FrontTree {
  static constexpr int kNone = -1;

  std::vector<int> order;      // block of S by its place in the order of elimination
  std::vector<Front> fronts;   // children before parents, every subtree in one piece
  std::vector<int> children;   // by front, ascending
  std::vector<FrontRun> runs;  // by front, ascending
  std::vector<FrontPiece> pieces;

  std::vector<FrontSegment> segments = std::vector<FrontSegment>(1);  // the last to be done first
  std::vector<int> segment_of;                                        // per front
  // per front: its first child if it takes children's update matrices as they come; -1: it does not
  std::vector<int> opened_by;
  std::vector<std::size_t> factor_begin, update_begin, vector_begin;  // per front
  std::size_t factor_size = 0, updates_size = 0, vectors_size = 0;

  double flops = 0.0;
  double entries = 0.0;  // of the factor
  bool dissected = false;

  std::size_t UpdateSize(int f) const {
    return static_cast<std::size_t>(fronts[f].update_stride()) * fronts[f].height;
  }
  /// Whether the front's update matrix is added to its parent as soon as it is there.
  bool IsTakenEarly(int f) const {
    const int parent = fronts[f].parent;
    return parent >= 0 && opened_by[parent] >= 0 && segment_of[parent] == segment_of[f];
  }
  std::size_t Bytes() const;
};

/// The tree of FindSymbolicFactor's order and fronts, in scalars. Fails as that does; `may_dissect`
/// is for it. one_by_one: segments run one after the other, each behind those before it in their
/// order, and need less memory.
Status BuildFrontTree(const BlockPattern& pattern, FrontTree* tree, bool may_dissect = true,
                      bool one_by_one = false);

/// Finds room for S in the memory of its own factor, and sets pattern->value_begin to it, as
/// offsets into that memory. Each block waits where the columns of later fronts will be, and is
/// read when its own front is opened; nothing reads S afterwards. So S takes no memory beside the
/// factor, but must be formed anew for each factorization. Moves the fronts' columns; the sum of
/// their sizes grows by about the blocks of one front for each segment.
void PlaceValuesInFactor(FrontTree* tree, BlockPattern* pattern);

}  // namespace inceres::internal
