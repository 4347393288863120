#include "linear/tree_substitution.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <limits>
#include <numeric>

#include "linear/front_elimination.h"
#include "linear/resuming.h"

namespace inceres::internal {

// Substitution in the Bayes tree, as far as a change reaches (docs/algorithms.md, "Reduced linear
// systems", Bayes tree; Kaess et al. 2012, algorithm 7). Per clique, with L₁ the triangle of its
// pivots and L₂ its other rows,
//
//     y₁ = L₁⁻¹ (b₁ + Σ_children y₂),    y₂ = Σ_children y₂ − L₂ y₁        forwards
//     x₁ = L₁⁻ᵀ (y₁ − L₂ᵀ x₂)                                            backwards.
//
// Forwards a change of b or L reaches the cliques above it, backwards a change of y or x those
// below. is_fresh_ carries from one to the other which y have changed since the last x.
//
// Wildfire: a clique below is solved again only if an x of its separator has moved since the x that
// it was solved with, which passed_on_ keeps, by more than the threshold. The comparison is with
// what was passed on, not with the last x: changes that are each too small add up until they are
// passed on. passed_on_ begins as NaN, unlike any x.

// Where a row has gone or come back, x of the rows behind it is no longer where it was.
// New rows at the end move nothing.
void TreeSubstitution::FollowPacking(const SymmetricBlockRows& S) {
  solution_is_lost_ |= packing_.Follow(S);
  x_.resize(packing_.size());
  moved_.resize(S.num_rows(), 0);
  passed_on_.resize(packing_.size(), std::numeric_limits<double>::quiet_NaN());  // unlike any x
}

// Their numbers may be given to other cliques.
void TreeSubstitution::ForgetDissolved() {
  tree_.EraseUnused(&unsubstituted_);
  gains_.Grow(tree_.cliques().size());
  for (const int c : tree_.dissolved()) {
    gains_.Set(c, 0.0);
  }
}

// New cliques have is_substituted cleared, as have those above, which are new as well.
void TreeSubstitution::Take(const std::vector<int>& made) {
  unsubstituted_.insert(unsubstituted_.end(), made.begin(), made.end());
}

// A row that S has but the tree does not is new, and its clique will be marked by Take.
void TreeSubstitution::MarkChangedB(const ReducedSolver::Rows& changed_b) {
  ForEachRow(changed_b, tree_.num_rows(), [this](int row) {
    if (tree_.Has(row)) {
      Mark(tree_.CliqueOf(row));
    }
  });
}

// Children first, by stamp. A clique that is not marked keeps its y, and what it has collected for
// its parent.
int TreeSubstitution::Forward(const double* b) {
  tree_.SortByStamp(&unsubstituted_);
  is_fresh_.resize(tree_.cliques().size(), 0);
  gains_.Grow(tree_.cliques().size());
  int num_rows = 0;
  for (const int c : unsubstituted_) {
    Clique& clique = tree_.clique(c);
    clique.is_substituted = true;
    is_fresh_[c] = 1;
    num_rows += clique.num_pivots;
    // The padding too, which the kernels read.
    std::fill(clique.y.begin(), clique.y.end(), 0.0);
    for (int k = 0; k < clique.num_pivots; ++k) {
      const int row = clique.rows[k];
      std::copy_n(b + packing_[row], tree_.SizeOf(row), clique.y.begin() + clique.places[k]);
    }
    for (const int child : clique.children) {
      const Clique& below = tree_.clique(child);
      // What the child's L₂ y₁ leaves to rows of this clique.
      const double* update = below.y.data() + below.front.below();
      for (const FrontRun& run : below.runs) {
        std::transform(update + run.from, update + run.from + run.length, clique.y.begin() + run.to,
                       clique.y.begin() + run.to, std::plus<>());
      }
    }
    SolveFrontForward(clique.front, clique.L.data(), clique.y.data());
    // bᵀA⁻¹b = yᵀy. The padding behind the pivots is zero.
    const auto end = clique.y.begin() + clique.front.below();
    gains_.Set(c, 0.5 * std::inner_product(clique.y.begin(), end, clique.y.begin(), 0.0));
  }
  unsubstituted_.clear();
  return num_rows;
}

// Each call has a number, by which moved_ tells what has moved in this one, without being cleared.
const std::vector<int>& TreeSubstitution::Backward(const Truncation& truncation, double* x) {
  ++num_solves_;
  solved_.clear();
  const auto is_root_to_solve = [this](int c) { return solution_is_lost_ || is_fresh_[c] != 0; };
  waiting_.clear();
  std::copy_if(tree_.roots().begin(), tree_.roots().end(), std::back_inserter(waiting_),
               is_root_to_solve);
  while (!waiting_.empty()) {
    const int c = waiting_.back();
    // Depth first: whichever child comes first, an x depends on its separator alone, so the order
    // does not change the bits.
    waiting_.pop_back();
    SolveClique(c, truncation, x);
    PushChildren(c);
  }
  solution_is_lost_ = false;
  // A fresh y below one that is not is not possible: y above it changed with it. So all fresh
  // cliques were reached.
  std::fill(is_fresh_.begin(), is_fresh_.end(), 0);
  if (static_cast<int>(solved_.size()) == tree_.num_rows()) {
    std::iota(solved_.begin(), solved_.end(), 0);
  } else {
    std::sort(solved_.begin(), solved_.end());
  }
  return solved_;
}

// x₁ = L₁⁻ᵀ (y₁ − L₂ᵀ x₂)
void TreeSubstitution::SolveClique(int c, const Truncation& truncation, double* x) {
  const Clique& clique = tree_.clique(c);
  const Front& front = clique.front;
  workspace_.resize(std::max(workspace_.size(), static_cast<std::size_t>(front.num_rows())));
  std::copy_n(clique.y.begin(), front.below(), workspace_.begin());
  for (std::size_t k = clique.num_pivots; k < clique.rows.size(); ++k) {
    const int row = clique.rows[k];
    std::copy(x_.begin() + packing_[row], x_.begin() + packing_[row + 1],
              workspace_.begin() + clique.places[k]);
  }
  // Products with the padding of L are with zeros, but what an earlier clique left here may be
  // infinite.
  std::fill(workspace_.begin() + front.below() + front.height,
            workspace_.begin() + front.num_rows(), 0.0);
  SolveFrontBackward(front, clique.L.data(), workspace_.data());
  for (int k = 0; k < clique.num_pivots; ++k) {
    const int row = clique.rows[k], begin = packing_[row], end = packing_[row + 1];
    std::copy_n(workspace_.begin() + clique.places[k], end - begin, x_.begin() + begin);
    std::copy(x_.begin() + begin, x_.begin() + end, x + begin);
    solved_.push_back(row);
    // A solution that was lost is passed on whole. x_ itself takes each new value, whether it is
    // passed on or not.
    if (solution_is_lost_ ||
        HasChanged(truncation, begin, x_.data() + begin, passed_on_.data() + begin, end - begin)) {
      std::copy(x_.begin() + begin, x_.begin() + end, passed_on_.begin() + begin);
      moved_[row] = num_solves_;
    }
  }
}

// y or an x above has changed. What the child does not know, those below it do not.
void TreeSubstitution::PushChildren(int c) {
  for (const int child : tree_.clique(c).children) {
    const Clique& clique = tree_.clique(child);
    const bool reached = solution_is_lost_ || is_fresh_[child] != 0 ||
                         std::any_of(clique.rows.begin() + clique.num_pivots, clique.rows.end(),
                                     [this](int row) { return moved_[row] == num_solves_; });
    if (reached) {
      waiting_.push_back(child);
    }
  }
}

}  // namespace inceres::internal
