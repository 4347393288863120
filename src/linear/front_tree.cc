#include "linear/front_tree.h"

#include <algorithm>

#include "linear/pattern_rows.h"
#include "linear/symbolic_factor.h"

namespace inceres::internal {

// From a symbolic factor in blocks to an assembly tree in scalars, with tasks and memory (Liu 1992;
// docs/algorithms.md, "Reduced linear systems"). All of it depends on the pattern alone and is done
// once for a structure.
//
// A front's parent has its first row beyond the pivots among its own pivots, and all of the others
// among its rows: that is what the elimination tree guarantees, and it makes the assembly a matter
// of runs of consecutive rows. Fronts are in postorder, so children come before parents and every
// subtree is a range.
//
// Tasks are segments: a subtree that is heavy, and has a heavy sibling, is one of its own, and what
// is left above runs when those it waits for are done. Update matrices live from their elimination
// to the parent's assembly. Within a segment they are placed as in a stack with gaps, planned here
// by going through the fronts in order; segments do not share memory, since they run at the same
// time, unless there is one thread only: then they run in the order in which each names those that
// come before it, and all share one stack.

namespace {

// What is worth a task of its own: a subtree of so many flops, and of such a share of all.
constexpr double kHeavyFlops = 1e6;
constexpr double kHeavyShare = 1.0 / 32;

// From blocks to scalars. A position is a block's place in the order.
class TreeBuilder {
 public:
  TreeBuilder(const BlockPattern& pattern, const SymbolicFactor& factor, FrontTree* tree)
      : pattern_(pattern), row_begin_(factor.row_begin), rows_(factor.rows), tree_(tree) {
    const int n = pattern.num_blocks();
    tree->order = factor.order;
    tree->dissected = factor.dissected;
    position_.resize(n);
    // By position: where each block of the order begins, in scalars.
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
      // Pivots of a front are consecutive positions.
      std::fill(front_of_.begin() + front.position_begin, front_of_.begin() + front.position_end,
                static_cast<int>(f));
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
          // The first row beyond the pivots: it begins on a quad of its own, and the front that
          // eliminates it is the parent.
          place = front.below();
          front.parent = front_of_[rows_[k]];
        }
        places_[k] = place;
        place += SizeAt(rows_[k]);
      }
      // A root has no row beyond its pivots.
      front.height = front.parent < 0 ? 0 : place - front.below();
    }
  }

  // Cuts a list into so many places a front, still empty; how many that makes.
  // The ends are pushed on as the places are filled.
  int Reserve(const std::vector<int>& count, int Front::*begin, int Front::*end) {
    int next = 0;
    for (std::size_t f = 0; f < tree_->fronts.size(); ++f) {
      tree_->fronts[f].*begin = tree_->fronts[f].*end = next;
      next += count[f];
    }
    return next;
  }

  // The children of a front are put side by side, by counting.
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
        // Ascending, for f ascends: the order in which update matrices are added, and of the sums.
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
      for (int k = row_begin_[f] + front.position_end - front.position_begin; k < row_begin_[f + 1];
           ++k) {
        // Both lists ascend and the parent's has all: one pass over it.
        while (rows_[in_parent] != rows_[k]) {
          ++in_parent;
        }
        // From a row of the update matrix to a row of the parent's front.
        const FrontRun run{places_[k] - front.below(), places_[in_parent], SizeAt(rows_[k])};
        FrontRun* last =
            static_cast<int>(tree_->runs.size()) > front.run_begin ? &tree_->runs.back() : nullptr;
        // Rows of the child follow each other without gaps, so the parent's places decide.
        if (last != nullptr && last->to + last->length == run.to) {
          last->length += run.length;
        } else {
          tree_->runs.push_back(run);
        }
      }
      front.run_end = static_cast<int>(tree_->runs.size());
    }
  }

  // First scalar row of a position in a front that has it: a binary search among its rows.
  int PlaceOf(int position, int front) const {
    const auto end = rows_.begin() + row_begin_[front + 1];
    return places_[std::lower_bound(rows_.begin() + row_begin_[front], end, position) -
                   rows_.begin()];
  }

  // The blocks of S front by front, so that a front is assembled from a list and S is read once.
  void FindPieces() {
    // A block is assembled where the first of its two rows is a pivot: it lies in that one's
    // columns.
    const auto front_of_block = [this](int i, int j) {
      return front_of_[std::min(position_[i], position_[j])];
    };
    std::vector<int> count(tree_->fronts.size(), 0);
    ForEachBlock(pattern_, [&](int i, int j, int) { ++count[front_of_block(i, j)]; });
    tree_->pieces.resize(Reserve(count, &Front::piece_begin, &Front::piece_end));
    ForEachBlock(pattern_, [&](int i, int j, int k) {
      const int f = front_of_block(i, j);
      tree_->pieces[tree_->fronts[f].piece_end++] = {i, k, PlaceOf(position_[i], f),
                                                     PlaceOf(position_[j], f)};
    });
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

// Memory of update matrices: the lowest gap, while the others wait.
class UpdatePlanner {
 public:
  /// From this place on.
  explicit UpdatePlanner(std::size_t begin = 0) : begin_(begin), peak_(begin) {}

  std::size_t Place(std::size_t size) {
    if (size == 0) {
      return begin_;  // of a root, which no parent frees
    }
    std::size_t begin = begin_;
    auto at = waiting_.begin();
    // First fit: past each piece that is too near until there is room.
    for (; at != waiting_.end() && at->begin < begin + size; ++at) {
      begin = at->end;
    }
    waiting_.insert(at, {begin, begin + size});
    peak_ = std::max(peak_, begin + size);
    return begin;
  }
  void Free(std::size_t begin) {
    waiting_.erase(std::find_if(waiting_.begin(), waiting_.end(),
                                [begin](const Piece& piece) { return piece.begin == begin; }));
  }
  std::size_t peak() const { return peak_; }

 private:
  struct Piece {
    std::size_t begin, end;
  };
  std::vector<Piece> waiting_;  // ascending
  const std::size_t begin_;
  std::size_t peak_;
};

// Cuts a tree into tasks, and places what each front needs.
class Scheduler {
 public:
  Scheduler(FrontTree* tree, bool one_by_one) : tree_(*tree), one_by_one_(one_by_one) {}

  void Plan() {
    CutIntoSegments();
    ChooseEarlyFronts();
    PlanMemory();
  }

 private:
  // A heavy subtree beside another one begins a segment; everything else goes with its parent.
  void CutIntoSegments() {
    const auto num_fronts = static_cast<int>(tree_.fronts.size());
    std::vector<double> flops(tree_.fronts.size(), 0.0);     // of subtrees
    std::vector<int> num_heavy(tree_.fronts.size() + 1, 0);  // children, and last the roots
    const auto parent_or_last = [&](int f) {
      return tree_.fronts[f].parent < 0 ? num_fronts : tree_.fronts[f].parent;
    };
    // Many segments of little work would cost more than they spread.
    const auto is_heavy = [&](int f) {
      return flops[f] > std::max(kHeavyFlops, kHeavyShare * tree_.flops);
    };
    for (int f = 0; f < num_fronts; ++f) {
      // Children come first, so what is in flops[f] by now is that of the subtrees below.
      flops[f] += tree_.fronts[f].flops();
      num_heavy[parent_or_last(f)] += is_heavy(f) ? 1 : 0;
      if (tree_.fronts[f].parent >= 0) {
        flops[tree_.fronts[f].parent] += flops[f];
      }
    }
    tree_.segments.assign(1, FrontSegment());
    tree_.segment_of.assign(tree_.fronts.size() + 1, 0);
    // From the roots down: a front takes its parent's segment unless it begins one. All roots count
    // as children of one more front, whose segment is 0.
    for (int f = num_fronts - 1; f >= 0; --f) {
      const int parent = parent_or_last(f);
      tree_.segment_of[f] = tree_.segment_of[parent];
      // A heavy child without a heavy sibling has nobody to run beside.
      if (is_heavy(f) && num_heavy[parent] > 1) {
        tree_.segment_of[f] = static_cast<int>(tree_.segments.size());
        tree_.segments[tree_.segment_of[parent]].before.push_back(tree_.segment_of[f]);
        tree_.segments.emplace_back();
      }
    }
    for (int f = 0; f < num_fronts; ++f) {
      tree_.segments[tree_.segment_of[f]].fronts.push_back(f);
    }
  }

  // A front that takes less than its children's update matrices together opens when the first of
  // them is there.
  void ChooseEarlyFronts() {
    tree_.opened_by.assign(tree_.fronts.size(), FrontTree::kNone);
    for (std::size_t f = 0; f < tree_.fronts.size(); ++f) {
      const Front& front = tree_.fronts[f];
      // What waits when the last child is eliminated: the update matrices of all others. Children
      // in other segments do not count; they wait elsewhere, in any case.
      std::size_t waiting = 0;
      int first = FrontTree::kNone;
      int last = FrontTree::kNone;
      for (int k = front.child_begin; k < front.child_end; ++k) {
        const int child = tree_.children[k];
        if (tree_.segment_of[child] == tree_.segment_of[f]) {
          waiting += last == FrontTree::kNone ? 0 : tree_.UpdateSize(last);
          first = first == FrontTree::kNone ? child : first;
          last = child;
        }
      }
      tree_.opened_by[f] =
          waiting > tree_.UpdateSize(static_cast<int>(f)) ? first : FrontTree::kNone;
    }
  }

  void PlanMemory() {
    // Columns of the factor, and vectors, stay: each front has its own.
    tree_.factor_begin.clear();
    tree_.vector_begin.clear();
    tree_.factor_size = tree_.vectors_size = tree_.updates_size = 0;
    for (const Front& front : tree_.fronts) {
      tree_.factor_begin.push_back(tree_.factor_size);
      tree_.vector_begin.push_back(tree_.vectors_size);
      tree_.factor_size += static_cast<std::size_t>(front.stride()) * front.width;
      tree_.vectors_size += static_cast<std::size_t>(front.num_rows());
    }
    tree_.update_begin.assign(tree_.fronts.size(), 0);
    if (one_by_one_) {
      UpdatePlanner planner;
      PlanUpdatesUpTo(tree_.segments.front(), &planner);
      tree_.updates_size = planner.peak();
      return;
    }
    // One stretch for each segment, however they run.
    for (const FrontSegment& segment : tree_.segments) {
      UpdatePlanner planner(tree_.updates_size);
      PlanUpdates(segment, &planner);
      tree_.updates_size = planner.peak();
    }
  }

  void PlanUpdatesUpTo(const FrontSegment& segment, UpdatePlanner* planner) {
    for (const int before : segment.before) {
      PlanUpdatesUpTo(tree_.segments[before], planner);
    }
    PlanUpdates(segment, planner);
  }

  // Places the update matrices of a segment's fronts.
  void PlanUpdates(const FrontSegment& segment, UpdatePlanner* planner) {
    for (const int f : segment.fronts) {
      if (tree_.opened_by[f] == FrontTree::kNone) {
        PlanOpening(f, planner);
      }
      // Its update matrix goes to the parent at once, which its first child opens.
      if (tree_.IsTakenEarly(f)) {
        if (tree_.opened_by[tree_.fronts[f].parent] == f) {
          PlanOpening(tree_.fronts[f].parent, planner);
        }
        planner->Free(tree_.update_begin[f]);
      }
    }
  }

  // A front is placed while its children still wait: it is assembled from them. Those of children
  // in other segments stay where they are, as long as these may run at any time.
  void PlanOpening(int f, UpdatePlanner* planner) {
    tree_.update_begin[f] = planner->Place(tree_.UpdateSize(f));
    for (int k = tree_.fronts[f].child_begin; k < tree_.fronts[f].child_end; ++k) {
      const int child = tree_.children[k];
      if (!tree_.IsTakenEarly(child) &&
          (one_by_one_ || tree_.segment_of[child] == tree_.segment_of[f])) {
        planner->Free(tree_.update_begin[child]);
      }
    }
  }

  FrontTree& tree_;
  const bool one_by_one_;
};

}  // namespace

std::size_t FrontTree::Bytes() const {
  return (order.capacity() + children.capacity()) * sizeof(int) +
         fronts.capacity() * sizeof(Front) + runs.capacity() * sizeof(FrontRun) +
         pieces.capacity() * sizeof(FrontPiece);
}

Status BuildFrontTree(const BlockPattern& pattern, FrontTree* tree, bool may_dissect,
                      bool one_by_one) {
  *tree = FrontTree();
  // No frames: an empty tree, with one segment that has nothing to do.
  if (pattern.num_blocks() == 0) {
    return Status::Ok();
  }
  SymbolicFactor factor;
  const Status found = FindSymbolicFactor(pattern, may_dissect, &factor);
  if (found.ok()) {
    TreeBuilder(pattern, factor, tree).Build();
    Scheduler(tree, one_by_one).Plan();
  }
  return found;
}

}  // namespace inceres::internal
