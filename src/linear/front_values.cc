#include "linear/front_values.h"

#include <algorithm>

namespace inceres::internal {

// S in the memory of its factor (docs/algorithms.md, "Reduced linear systems"). Every block of S is
// assembled into the columns of one front, so what S has left to give is never larger than what
// the factor has left to take: with the columns in the order in which fronts are opened, and S in
// the same order at the end, the one is written behind where the other is read. Segments of the
// tree run at the same time, and have a stretch of memory each.

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

  // From `begin` on; where the next one begins.
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

  // Up to `end`, in the order of the fronts.
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
