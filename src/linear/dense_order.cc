#include "linear/dense_order.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "linear/block_neighbors.h"
#include "linear/envelope_order.h"
#include "linear/group_order.h"
#include "linear/pattern_rows.h"

namespace inceres::internal {

// An order of the frames for the dense Cholesky that leaves zeros ahead of the rows (King 1970;
// George & Liu 1981, chapter 4). King's rule works through the graph of S as a wave does: rows that
// are done, a front of rows that are coupled to those, and rows ahead. Next comes the row whose
// neighbors let the fewest scalar rows into the front, because the rows in the front are those that
// the columns of the factor reach.
//
// Whether that helps depends on S: where all frames see the same landmarks there is nothing to
// leave out. So the flops of both orders are counted, and the pattern's own stays where King's is
// no better.

namespace {

class FrontOrdering {
 public:
  explicit FrontOrdering(const BlockPattern& pattern)
      : pattern_(pattern),
        graph_(pattern),
        growth_(pattern.num_blocks(), 0),
        state_(pattern.num_blocks(), kAhead) {
    ForEachCoupling(pattern, [this](int row, int column) {
      growth_[row] += pattern_.block_size(column);
      growth_[column] += pattern_.block_size(row);
    });
  }

  std::vector<int> Order() {
    std::vector<int> order;
    order.reserve(state_.size());
    while (order.size() < state_.size()) {
      // An empty front means that a component of the graph is done, or that nothing has begun: then
      // the row with the fewest neighbors begins another one.
      const int next = SmallestGrowth(front_size_ > 0 ? kInFront : kAhead);
      EnterFront(next);
      for (int k = graph_.begin[next]; k < graph_.begin[next + 1]; ++k) {
        EnterFront(graph_.rows[k]);
      }
      state_[next] = kDone;
      --front_size_;
      order.push_back(next);
    }
    return order;
  }

 private:
  enum State : char { kAhead, kInFront, kDone };

  int SmallestGrowth(State state) const {
    int best = -1;
    for (int block = 0; block < pattern_.num_blocks(); ++block) {
      // Strictly less: of equals the first in the pattern's order. A pass over all blocks, which is
      // the quadratic part of the cost.
      if (state_[block] == state && (best < 0 || growth_[block] < growth_[best])) {
        best = block;
      }
    }
    return best;
  }

  void EnterFront(int block) {
    if (state_[block] == kAhead) {
      state_[block] = kInFront;
      ++front_size_;
      for (int k = graph_.begin[block]; k < graph_.begin[block + 1]; ++k) {
        // Whoever is coupled to this block has one neighbor less that would enter on his account.
        growth_[graph_.rows[k]] -= pattern_.block_size(block);
      }
    }
  }

  const BlockPattern& pattern_;
  BlockNeighbors<int> graph_;
  std::vector<int> growth_;  // scalar rows that would enter the front if it were next
  std::vector<State> state_;
  int front_size_ = 0;
};

DenseOrder InOrder(const BlockPattern& pattern, std::vector<int> blocks) {
  DenseOrder order;
  order.offsets.assign(1, 0);
  order.first.resize(blocks.size());
  // A row without blocks ahead begins at its own place.
  std::iota(order.first.begin(), order.first.end(), 0);
  std::vector<int> place(blocks.size());
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    place[blocks[k]] = static_cast<int>(k);
    order.offsets.push_back(order.offsets.back() + pattern.block_size(blocks[k]));
  }
  ForEachCoupling(pattern, [&](int row, int column) {
    // Of a block the later of its two rows, in this order, has it ahead of its diagonal.
    const int a = place[row], b = place[column];
    int& first = order.first[std::max(a, b)];
    first = std::min(first, std::min(a, b));
  });
  order.blocks = std::move(blocks);
  for (std::size_t k = 0; k < order.blocks.size(); ++k) {
    const double rows = order.offsets[k + 1] - order.offsets[k];
    // The whole span from the first block on counts, and the lower triangle of the diagonal block.
    order.entries +=
        rows * (order.offsets[k] - order.offsets[order.first[k]]) + 0.5 * rows * (rows + 1.0);
  }
  order.flops = WorkOfRows(order.first.data(), order.offsets.data(), 0, pattern.num_blocks()).flops;
  return order;
}

}  // namespace

DenseOrder OrderForEnvelope(const BlockPattern& pattern) {
  std::vector<int> own(pattern.num_blocks());
  std::iota(own.begin(), own.end(), 0);
  std::vector<int> front = FrontOrdering(pattern).Order();
  SortByGroup(pattern, &own);
  SortByGroup(pattern, &front);
  DenseOrder order = InOrder(pattern, std::move(own));
  DenseOrder other = InOrder(pattern, std::move(front));
  return other.flops < order.flops ? other : order;
}

}  // namespace inceres::internal
