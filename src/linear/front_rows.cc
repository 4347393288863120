#include "linear/front_rows.h"

#include <algorithm>

namespace inceres::internal {

// Which scalar of S stands in which row of a front, for who reads a factor entry by entry
// (SelectedInverse, FrontQr); docs/algorithms.md, "Covariance".
//
// Pivots of fronts are consecutive positions of the order, front after front, so a pivot's row is a
// difference of positions. The other rows of a front are listed by their positions, which ascend,
// and are found by bisection. No list of them is kept in the tree, which has runs into the parent
// only, so they are followed from the roots down, once.

FrontRows::FrontRows(const FrontTree& tree, const BlockPattern& pattern) : tree_(tree) {
  const auto num_blocks = static_cast<std::size_t>(pattern.num_blocks());
  position_.resize(num_blocks);
  size_.resize(num_blocks);
  front_of_.resize(num_blocks);
  int scalar = 0;
  others_begin_ = {0};
  // Fronts are in the order of elimination, and so are the blocks within each.
  for (std::size_t f = 0; f < tree_.fronts.size(); ++f) {
    const Front& front = tree_.fronts[f];
    first_pivot_.push_back(scalar);
    for (int at = front.position_begin; at < front.position_end; ++at) {
      const int block = tree_.order[at];
      position_[block] = scalar;
      size_[block] = pattern.block_size(block);
      front_of_[block] = static_cast<int>(f);
      scalar += size_[block];
    }
    others_begin_.push_back(others_begin_.back() + static_cast<std::size_t>(front.height));
  }
  others_.resize(others_begin_.back());
  // Parents come behind their children.
  for (int f = static_cast<int>(tree_.fronts.size()) - 1; f >= 0; --f) {
    ListOthers(f);
  }
}

// They are among the rows of its parent, which is listed before.
void FrontRows::ListOthers(int f) {
  const Front& front = tree_.fronts[f];
  for (int run = front.run_begin; run < front.run_end; ++run) {
    const Front& parent = tree_.fronts[front.parent];
    for (int k = 0; k < tree_.runs[run].length; ++k) {
      const int to = tree_.runs[run].to + k;
      // A row of the parent is one of its pivots, or one of its other rows behind their padding.
      others_[others_begin_[f] + tree_.runs[run].from + k] =
          to < parent.width ? first_pivot_[front.parent] + to
                            : others_[others_begin_[front.parent] + to - parent.below()];
    }
  }
}

// The position must not lie ahead of the front's pivots. Cost: a bisection, for rows that are not
// pivots.
int FrontRows::RowIn(int front, int position) const {
  const int pivot = position - first_pivot_[front];
  if (pivot < tree_.fronts[front].width) {
    return pivot;
  }
  const auto begin = others_.begin() + static_cast<std::ptrdiff_t>(others_begin_[front]);
  const auto end = others_.begin() + static_cast<std::ptrdiff_t>(others_begin_[front + 1]);
  const auto found = std::lower_bound(begin, end, position);
  return found == end || *found != position
             ? -1
             : tree_.fronts[front].width + static_cast<int>(found - begin);
}

}  // namespace inceres::internal
