#include <algorithm>
#include <cstdint>
#include <vector>

#include "linear/front_tree.h"

namespace inceres::internal {

// S in the memory of its factor (docs/algorithms.md, "Reduced linear systems"). Every block of S is
// assembled into the columns of one front, so what S has left to give is never larger than what the
// factor has left to take: with the columns in the order in which fronts are opened, and S in the
// same order at the end, the one is written behind where the other is read. Segments of the tree
// run at the same time, and have a stretch of memory each.
//
// With the fronts of a segment in that order, c_k entries of columns and v_k of S in front k, what
// S has left at front k, the last v_k + v_k+1 + … entries of the stretch, must begin no earlier
// than the columns of front k end, at c_0 + … + c_k: these are cleared before its blocks are read.
// PlaceSegment takes the smallest end for which that holds at each front.

namespace {

// The fronts of a segment as SparseCholesky opens them: a parent that takes its children's update
// matrices as they come is opened by the first of them.
std::vector<int> FrontsAsOpened(const FrontTree& tree, const FrontSegment& segment) {
  std::vector<int> opened;
  for (const int f : segment.fronts) {
    if (tree.opened_by[f] == FrontTree::kNone) {
      opened.push_back(f);
    }
    if (tree.IsTakenEarly(f) && tree.opened_by[tree.fronts[f].parent] == f) {
      opened.push_back(tree.fronts[f].parent);
    }
  }
  return opened;
}

class ValuePlanner {
 public:
  ValuePlanner(FrontTree* tree, BlockPattern* pattern) : tree_(*tree), pattern_(*pattern) {}

  void Run() {
    std::size_t begin = 0;
    for (const FrontSegment& segment : tree_.segments) {
      begin = PlaceSegment(FrontsAsOpened(tree_, segment), begin);
    }
    tree_.factor_size = begin;
    pattern_.value_begin.back() = static_cast<std::int64_t>(begin);
  }

 private:
  std::size_t SizeOfBlock(const FrontPiece& piece) const {
    return static_cast<std::size_t>(pattern_.block_size(piece.i)) *
           static_cast<std::size_t>(pattern_.row_stride(pattern_.columns[piece.block]));
  }
  // All pieces of a front, each of which is a whole block of S, rows padded if those of the pattern
  // are.
  std::size_t SizeOfValues(int f) const {
    std::size_t size = 0;
    for (int k = tree_.fronts[f].piece_begin; k < tree_.fronts[f].piece_end; ++k) {
      size += SizeOfBlock(tree_.pieces[k]);
    }
    return size;
  }
  std::size_t SizeOfColumns(int f) const {
    return static_cast<std::size_t>(tree_.fronts[f].stride()) * tree_.fronts[f].width;
  }

  // From `begin` on; where the next one begins. S is packed against the end, so what is left of it
  // at a front takes the last `values_left` entries; the end moves up where the columns would reach
  // into them.
  std::size_t PlaceSegment(const std::vector<int>& fronts, std::size_t begin) {
    std::size_t values_left = 0;
    for (const int f : fronts) {
      values_left += SizeOfValues(f);
    }
    // What is left of S begins behind the columns of the front that is about to be opened.
    std::size_t column = begin;
    std::size_t end = begin + values_left;
    for (const int f : fronts) {
      tree_.factor_begin[f] = column;
      column += SizeOfColumns(f);
      end = std::max(end, column + values_left);
      values_left -= SizeOfValues(f);
    }
    // Columns are at whole quads.
    end = (end + kQuad - 1) / kQuad * kQuad;
    PlaceValues(fronts, end);
    return end;
  }

  // Up to `end`, in the order of the fronts. From the last front back to the first, so that the
  // first one's blocks come first and are read first. Within a front blocks are in the order of its
  // pieces.
  void PlaceValues(const std::vector<int>& fronts, std::size_t end) {
    for (auto f = fronts.rbegin(); f != fronts.rend(); ++f) {
      std::size_t next = end -= SizeOfValues(*f);
      for (int k = tree_.fronts[*f].piece_begin; k < tree_.fronts[*f].piece_end; ++k) {
        pattern_.value_begin[tree_.pieces[k].block] = static_cast<std::int64_t>(next);
        next += SizeOfBlock(tree_.pieces[k]);
      }
    }
  }

  FrontTree& tree_;
  BlockPattern& pattern_;
};

}  // namespace

void PlaceValuesInFactor(FrontTree* tree, BlockPattern* pattern) {
  ValuePlanner(tree, pattern).Run();
}

}  // namespace inceres::internal
