#include "linear/front_tree.h"

#include <cholmod.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace inceres::internal {
namespace {

// Cutting the graph takes milliseconds where AMD takes one: only a factor this expensive may win that back within a solve.
constexpr double kMinFlopsForDissection = 3e7;
// Pieces up to this share of the blocks are not cut: then the first cut is mostly the only one. Cut on (METIS's own order, pieces
// of a third or a twelfth), paths with loops take up to three times the flops, pose graphs and grids between 0.8 and 1.3 times.
constexpr double kLargestPiece = 2.0 / 3;
// The halves are factored side by side, which a chain's AMD order would not allow: worth these flops more.
constexpr double kWorthOfHalves = 1.05;

// Columns up to which fronts are joined, and the share of zeros that may bring: the rules of CHOLMOD's own analysis, in scalars.
constexpr double kJoinedColumns[] = {24.0, 48.0, 96.0};

class CholmodSession {
 public:
  CholmodSession() {
    cholmod_start(&common_);
    common_.print = 0;
  }
  ~CholmodSession() { cholmod_finish(&common_); }
  CholmodSession(const CholmodSession&) = delete;
  CholmodSession& operator=(const CholmodSession&) = delete;
  cholmod_common* common() { return &common_; }

 private:
  cholmod_common common_;
};

// The symbolic supernodal analysis of the block graph in one order.
class Analysis {
 public:
  explicit Analysis(CholmodSession* session) : common_(session->common()) {}
  ~Analysis() { cholmod_free_factor(&factor_, common_); }
  Analysis(const Analysis&) = delete;
  Analysis& operator=(const Analysis&) = delete;

  // False when out of memory.
  bool Run(const BlockPattern& pattern, int method) {
    const auto n = static_cast<std::size_t>(pattern.num_blocks());
    cholmod_sparse* graph = cholmod_allocate_sparse(n, n, pattern.columns.size(), 1, 1, 1, CHOLMOD_PATTERN, common_);
    if (graph == nullptr) {
      return false;
    }
    // The lower triangle by rows is the upper one by columns.
    std::copy(pattern.row_begin.begin(), pattern.row_begin.end(), static_cast<int*>(graph->p));
    std::copy(pattern.columns.begin(), pattern.columns.end(), static_cast<int*>(graph->i));
    common_->nmethods = 1;
    common_->method[0].ordering = method;
    common_->method[0].nd_small = static_cast<std::size_t>(kLargestPiece * static_cast<double>(n)) + 1;
    common_->postorder = 1;
    common_->supernodal = CHOLMOD_SUPERNODAL;
    const double mean_size = static_cast<double>(pattern.size()) / pattern.num_blocks();
    for (int k = 0; k < 3; ++k) {
      common_->nrelax[k] = static_cast<std::size_t>(std::ceil(kJoinedColumns[k] / mean_size));
    }
    factor_ = cholmod_analyze(graph, common_);
    cholmod_free_sparse(&graph, common_);
    flops_ = common_->fl * mean_size * mean_size * mean_size;
    return factor_ != nullptr;
  }

  void Swap(Analysis* other) {
    std::swap(factor_, other->factor_);
    std::swap(flops_, other->flops_);
  }

  double flops() const { return flops_; }
  int num_fronts() const { return static_cast<int>(factor_->nsuper); }
  const int* order() const { return static_cast<const int*>(factor_->Perm); }
  const int* columns() const { return static_cast<const int*>(factor_->super); }
  const int* row_begin() const { return static_cast<const int*>(factor_->pi); }
  const int* rows() const { return static_cast<const int*>(factor_->s); }

 private:
  cholmod_common* common_;
  cholmod_factor* factor_ = nullptr;
  double flops_ = 0.0;  // of scalars
};

// From blocks to scalars. A position is a block's place in the order.
class TreeBuilder {
 public:
  TreeBuilder(const BlockPattern& pattern, const Analysis& analysis, FrontTree* tree)
      : pattern_(pattern), row_begin_(analysis.row_begin()), rows_(analysis.rows()), tree_(tree) {
    const int n = pattern.num_blocks();
    tree->order.assign(analysis.order(), analysis.order() + n);
    position_.resize(n);
    offsets_ = {0};
    for (int at = 0; at < n; ++at) {
      position_[tree->order[at]] = at;
      offsets_.push_back(offsets_.back() + pattern.block_size(tree->order[at]));
    }
    front_of_.resize(n);
    tree->fronts.resize(analysis.num_fronts());
    for (int f = 0; f < analysis.num_fronts(); ++f) {
      Front& front = tree->fronts[f];
      front.position_begin = analysis.columns()[f];
      front.position_end = analysis.columns()[f + 1];
      std::fill(front_of_.begin() + front.position_begin, front_of_.begin() + front.position_end, f);
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
    const int* end = rows_ + row_begin_[front + 1];
    return places_[std::lower_bound(rows_ + row_begin_[front], end, position) - rows_];
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
  const int* row_begin_;  // per front: among rows_
  const int* rows_;       // positions, the pivots first
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
  CholmodSession session;
  Analysis best(&session);
  bool found = best.Run(pattern, CHOLMOD_AMD);
  if (!found || (may_dissect && best.flops() >= kMinFlopsForDissection)) {
    Analysis halves(&session);
    if (halves.Run(pattern, CHOLMOD_NESDIS) && (!found || halves.flops() < kWorthOfHalves * best.flops())) {
      best.Swap(&halves);
      found = tree->dissected = true;
    }
  }
  if (!found) {
    return Status::Error(StatusCode::kUnavailable, "CHOLMOD could not order the reduced system (out of memory?)");
  }
  TreeBuilder(pattern, best, tree).Build();
  return Status::Ok();
}

}  // namespace inceres::internal
