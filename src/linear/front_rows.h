#pragma once

#include <cstddef>
#include <vector>

#include "linear/front_tree.h"

namespace inceres::internal {

/// Which scalar stands where in the fronts of a sparse factor. A position is a scalar's place in
/// the order of elimination; the rows of a front are its pivots, then its other rows, without the
/// padding. The tree stays as it is as long as this is used.
class FrontRows {
 public:
  FrontRows(const FrontTree& tree, const BlockPattern& pattern);

  int position(int block) const { return position_[static_cast<std::size_t>(block)]; }
  int size(int block) const { return size_[static_cast<std::size_t>(block)]; }
  /// In which it is a pivot.
  int front_of(int block) const { return front_of_[static_cast<std::size_t>(block)]; }
  int first_pivot(int front) const { return first_pivot_[static_cast<std::size_t>(front)]; }
  /// The row of a front at which this position is; −1: it has none.
  int RowIn(int front, int position) const;

 private:
  void ListOthers(int front);

  const FrontTree& tree_;
  std::vector<int> position_;     // first scalar of each block
  std::vector<int> size_;         // of each block
  std::vector<int> front_of_;     // per block
  std::vector<int> first_pivot_;  // per front: the position of its first pivot
  std::vector<int> others_;       // per front: the positions of its other rows
  std::vector<std::size_t> others_begin_;
};

}  // namespace inceres::internal
