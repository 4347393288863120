#include "linear/front_tree.h"

#include <algorithm>

#include "linear/symbolic_factor.h"

namespace inceres::internal {
namespace {

// From blocks to scalars. A position is a block's place in the order.
class TreeBuilder {
 public:
  TreeBuilder(const BlockPattern& pattern, const SymbolicFactor& factor, FrontTree* tree)
      : pattern_(pattern), row_begin_(factor.row_begin), rows_(factor.rows), tree_(tree) {
    const int n = pattern.num_blocks();
    tree->order = factor.order;
    tree->dissected = factor.dissected;
    position_.resize(n);
    offsets_ = {0};
    for (int at = 0; at < n; ++at) {
      position_[tree->order[at]] = at;
      offsets_.push_back(offsets_.back() + pattern.block_size(tree->order[at]));
    }
    front_of_.resize(n);
    tree->fronts.resize(factor.front_begin.size() - 1);
    for (std::size_t f = 0; f < tree->fronts.size(); ++f) {
      Front& front = tree->fronts[f];
      front.position_begin = factor.front_begin[f];
      front.position_end = factor.front_begin[f + 1];
      std::fill(front_of_.begin() + front.position_begin, front_of_.begin() + front.position_end, static_cast<int>(f));
    }
  }

  void Build() {
    PlaceRows();
    LinkChildren();
    FindRuns();
    FindPieces();
    for (const Front& front : tree_->fronts) {
      tree_->flops += front.flops();
      tree_->entries += front.width * (0.5 * (front.width + 1) + front.height);
    }
  }

 private:
  int SizeAt(int position) const { return offsets_[position + 1] - offsets_[position]; }

  void PlaceRows() {
    places_.resize(row_begin_[tree_->fronts.size()]);
    for (std::size_t f = 0; f < tree_->fronts.size(); ++f) {
      Front& front = tree_->fronts[f];
      front.width = offsets_[front.position_end] - offsets_[front.position_begin];
      const int num_pivots = front.position_end - front.position_begin;
      int place = 0;
      for (int k = row_begin_[f]; k < row_begin_[f + 1]; ++k) {
        if (k == row_begin_[f] + num_pivots) {
          place = front.below();
          front.parent = front_of_[rows_[k]];
        }
        places_[k] = place;
        place += SizeAt(rows_[k]);
      }
      front.height = front.parent < 0 ? 0 : place - front.below();
    }
  }

  // Cuts a list into so many places a front, still empty; how many that makes.
  int Reserve(const std::vector<int>& count, int Front::*begin, int Front::*end) {
    int next = 0;
    for (std::size_t f = 0; f < tree_->fronts.size(); ++f) {
      tree_->fronts[f].*begin = tree_->fronts[f].*end = next;
      next += count[f];
    }
    return next;
  }

  void LinkChildren() {
    std::vector<int> count(tree_->fronts.size(), 0);
    for (const Front& front : tree_->fronts) {
      if (front.parent >= 0) {
        ++count[front.parent];
      }
    }
    tree_->children.resize(Reserve(count, &Front::child_begin, &Front::child_end));
    for (std::size_t f = 0; f < tree_->fronts.size(); ++f) {
      if (tree_->fronts[f].parent >= 0) {
        tree_->children[tree_->fronts[tree_->fronts[f].parent].child_end++] = static_cast<int>(f);
      }
    }
  }

  // The rows of a front that are not pivots are all among those of its parent, in the same order.
  void FindRuns() {
    for (std::size_t f = 0; f < tree_->fronts.size(); ++f) {
      Front& front = tree_->fronts[f];
      front.run_begin = static_cast<int>(tree_->runs.size());
      int in_parent = front.parent < 0 ? 0 : row_begin_[front.parent];
      for (int k = row_begin_[f] + front.position_end - front.position_begin; k < row_begin_[f + 1]; ++k) {
        while (rows_[in_parent] != rows_[k]) {
          ++in_parent;
        }
        const FrontRun run{places_[k] - front.below(), places_[in_parent], SizeAt(rows_[k])};
        FrontRun* last = static_cast<int>(tree_->runs.size()) > front.run_begin ? &tree_->runs.back() : nullptr;
        if (last != nullptr && last->to + last->length == run.to) {
          last->length += run.length;
        } else {
          tree_->runs.push_back(run);
        }
      }
      front.run_end = static_cast<int>(tree_->runs.size());
    }
  }

  int PlaceOf(int position, int front) const {
    const auto end = rows_.begin() + row_begin_[front + 1];
    return places_[std::lower_bound(rows_.begin() + row_begin_[front], end, position) - rows_.begin()];
  }

  void FindPieces() {
    const auto front_of_block = [this](int i, int j) { return front_of_[std::min(position_[i], position_[j])]; };
    std::vector<int> count(tree_->fronts.size(), 0);
    ForEachBlock([&](int i, int j, int) { ++count[front_of_block(i, j)]; });
    tree_->pieces.resize(Reserve(count, &Front::piece_begin, &Front::piece_end));
    ForEachBlock([&](int i, int j, int k) {
      const int f = front_of_block(i, j);
      tree_->pieces[tree_->fronts[f].piece_end++] = {pattern_.value_begin[k], PlaceOf(position_[i], f), PlaceOf(position_[j], f),
                                                     pattern_.block_size(i), pattern_.block_size(j)};
    });
  }

  template <typename Visit>
  void ForEachBlock(const Visit& visit) const {
    for (int i = 0; i < pattern_.num_blocks(); ++i) {
      for (int k = pattern_.row_begin[i]; k < pattern_.row_begin[i + 1]; ++k) {
        visit(i, pattern_.columns[k], k);
      }
    }
  }

  const BlockPattern& pattern_;
  const std::vector<int>& row_begin_;  // per front: among rows_
  const std::vector<int>& rows_;       // positions, the pivots first
  FrontTree* tree_;
  std::vector<int> position_;  // per block
  std::vector<int> offsets_;   // per position: first scalar; and one more
  std::vector<int> front_of_;  // per position
  std::vector<int> places_;    // per entry of rows_: its first scalar row in the front
};

}  // namespace

std::size_t FrontTree::Bytes() const {
  return (order.capacity() + children.capacity()) * sizeof(int) + fronts.capacity() * sizeof(Front) +
         runs.capacity() * sizeof(FrontRun) + pieces.capacity() * sizeof(FrontPiece);
}

Status BuildFrontTree(const BlockPattern& pattern, FrontTree* tree, bool may_dissect) {
  *tree = FrontTree();
  if (pattern.num_blocks() == 0) {
    return Status::Ok();
  }
  SymbolicFactor factor;
  const Status found = FindSymbolicFactor(pattern, may_dissect, &factor);
  if (found.ok()) {
    TreeBuilder(pattern, factor, tree).Build();
  }
  return found;
}

}  // namespace inceres::internal
