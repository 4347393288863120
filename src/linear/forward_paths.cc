#include "linear/forward_paths.h"

#include <algorithm>
#include <cstdint>

#include "linear/front_elimination.h"
#include "simd/kernels.h"

namespace inceres::internal {

// Forward substitution in a Bayes tree with columns of few rows (docs/algorithms.md, "From a live
// factor"). All vectors are copies: the tree's own y is not touched. Nothing here is as long as the
// tree has cliques, so that what a short path costs does not grow with the problem.

// For who adds to any clique: all of them, in the order of their stamps, and memory for one column
// that is cleared as it is used.
ForwardPaths::ForwardPaths(const CliqueTree& tree) : tree_(&tree), lanes_(1) {
  for (std::size_t c = 0; c < tree.cliques().size(); ++c) {
    if (tree.cliques()[c].is_used) {
      cliques_.push_back(static_cast<int>(c));
    }
  }
  LayOut();
}

// Columns are padded to whole vectors of the kernels, with zeros that stay zero. Cliques of the
// paths from each row to its root are gathered with repeats, which LayOut takes out: the paths of
// neighboring rows share most of their cliques. Solving goes by ascending stamps, children first,
// so each clique has all that it gets when its turn comes, and sums are formed in one order
// whatever order the rows of V have.
ForwardPaths::ForwardPaths(const CliqueTree& tree, const SparseColumns& V) : tree_(&tree) {
  const int columns = static_cast<int>(V.values.cols());
  const int width = std::max(kQuad, BestKernels().width);
  lanes_ = (columns + width - 1) / width * width;
  for (const int row : V.rows) {
    for (int c = tree.CliqueOf(row); c != CliqueTree::kNone; c = tree.clique(c).front.parent) {
      cliques_.push_back(c);
    }
  }
  LayOut();
  // Zeros but in the rows of V, each of which is a pivot of the clique it begins in.
  for (std::size_t k = 0; k < V.rows.size(); ++k) {
    const int row = V.rows[k];
    double* y = Of(Find(tree.CliqueOf(row), 0)) + std::ptrdiff_t{tree.PlaceOf(row)} * lanes_;
    for (int r = 0; r < tree.SizeOf(row); ++r, y += lanes_) {
      for (int column = 0; column < columns; ++column) {
        y[column] = V.values(V.begin[k] + r, column);
      }
    }
  }
  for (int i = 0; i < size(); ++i) {
    SolveForward(i);
  }
}

// One piece of memory for all fronts, each with the room of its pivots and its separator for all
// lanes. It is cleared front by front, by Of.
void ForwardPaths::LayOut() {
  tree_->SortByStamp(&cliques_);
  cliques_.erase(std::unique(cliques_.begin(), cliques_.end()), cliques_.end());
  begin_.push_back(0);
  for (const int c : cliques_) {
    begin_.push_back(begin_.back() +
                     static_cast<std::size_t>(lanes_) * tree_->clique(c).front.num_rows());
  }
  values_.reset(new double[begin_.back()]);  // cleared as they come up
  is_begun_.assign(cliques_.size(), 0);
}

// Else a search by stamps. The clique is there: with a clique all above it are.
int ForwardPaths::Find(int c, int from) const {
  // A path goes from each clique to the next.
  if (from < size() && cliques_[from] == c) {
    return from;
  }
  const auto at = std::lower_bound(
      cliques_.begin() + from, cliques_.end(), tree_->clique(c).stamp,
      [this](int a, std::int64_t stamp) { return tree_->clique(a).stamp < stamp; });
  return static_cast<int>(at - cliques_.begin());
}

// Zero until something is added.
double* ForwardPaths::Of(int i) {
  double* first = values_.get() + begin_[i];
  if (is_begun_[i] == 0) {
    std::fill(first, values_.get() + begin_[i + 1], 0.0);
    is_begun_[i] = 1;
  }
  return first;
}

// y₂ after the pivots were taken out is what the parent gets, by the runs that the update matrix
// has.
void ForwardPaths::SolveForward(int i) {
  const Front& front = clique(i).front;
  double* y = Of(i);
  SolveFrontForward(front, clique(i).L.data(), lanes_, y);
  if (front.parent == CliqueTree::kNone) {
    return;
  }
  const double* update = y + std::ptrdiff_t{front.below()} * lanes_;
  double* above = Of(Find(front.parent, i + 1));
  for (const FrontRun& run : clique(i).runs) {
    const double* __restrict__ from = update + std::ptrdiff_t{run.from} * lanes_;
    double* __restrict__ to = above + std::ptrdiff_t{run.to} * lanes_;
    for (int k = 0; k < run.length * lanes_; ++k) {
      to[k] += from[k];
    }
  }
}

// Clique by clique that both reach: its pivots' rows. Those beyond belong to cliques further up. A
// walk along both lists, which ascend by stamp, as a merge does. The kernel subtracts products, so
// the sum has the wrong sign until the end; it runs over cliques upward and over the rows of each,
// in one order. Cost: the pivots that both reach, times lanes of both.
Eigen::MatrixXd ForwardPaths::InnerProducts(const ForwardPaths& other) const {
  Eigen::MatrixXd negative = Eigen::MatrixXd::Zero(lanes_, other.lanes_);
  for (int i = 0, j = 0; i < size() && j < other.size();) {
    const Clique &a = clique(i), &b = other.clique(j);
    if (&a == &b) {
      BestKernels().subtract_outer(lanes_, other.lanes_, a.front.width, values_.get() + begin_[i],
                                   lanes_, other.values_.get() + other.begin_[j], other.lanes_,
                                   negative.data(), lanes_);
    }
    i += a.stamp <= b.stamp ? 1 : 0;
    j += b.stamp <= a.stamp ? 1 : 0;
  }
  return -negative;
}

}  // namespace inceres::internal
