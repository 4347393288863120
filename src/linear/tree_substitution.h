#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "base/sum_tree.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/clique_tree.h"
#include "linear/row_order.h"

namespace inceres::internal {

/// The substitutions of a factored Bayes tree, of which those parts are made anew that a change has
/// reached:
///
///     y = L⁻¹b   the cliques that were factored, those of changed entries of b, and what is above
///     x = L⁻ᵀy   from the roots down, where y or an x above has changed ("wildfire")
///
/// y is kept by the cliques, x here, packed as the caller's vectors are. Truncation: each x is
/// compared with the value that the cliques below were last computed with, so that many small
/// changes add up and are noticed. Source: Kaess et al., "iSAM2: Incremental smoothing and mapping
/// using the Bayes tree", IJRR 31(2), 2012, algorithm 7.
class TreeSubstitution {
 public:
  /// The tree belongs to who factors it, and stays where it is.
  explicit TreeSubstitution(CliqueTree* tree) : tree_(*tree) {}

  /// S has other rows.
  void FollowPacking(const SymmetricBlockRows& S);
  /// Where the row begins in a packed vector; also one behind the last.
  int Offset(int row) const { return packing_[row]; }
  /// The tree has dissolved cliques, and made these instead.
  void ForgetDissolved();
  void Take(const std::vector<int>& made);

  /// The clique was factored: its y, and those above, are to be made anew.
  void Mark(int c) { tree_.ClearUpwards(c, &Clique::is_substituted, &unsubstituted_); }
  void MarkChangedB(const ReducedSolver::Rows& changed_b);
  /// Somebody else wrote the caller's x.
  void LoseSolution() { solution_is_lost_ = true; }

  /// y of what is marked; returns how many rows that were.
  int Forward(const double* b);
  /// ½ yᵀy: what x gains.
  double Gain() const { return gains_.sum(); }
  /// x where it is reached, into the caller's as well; the rows that were solved, ascending.
  const std::vector<int>& Backward(const ReducedSolver::Truncation& truncation, double* x);

  std::size_t Bytes() const {
    return gains_.Bytes() + (x_.capacity() + passed_on_.capacity()) * sizeof(double) +
           moved_.capacity() * sizeof(std::int64_t);
  }

 private:
  using Truncation = ReducedSolver::Truncation;
  void SolveClique(int c, const Truncation& truncation, double* x);
  void PushChildren(int c);

  CliqueTree& tree_;
  RowPacking packing_;               // of the caller's vectors
  std::vector<int> unsubstituted_;   // cliques, with each those above it
  std::vector<char> is_fresh_;       // per clique: y has changed since the last x
  std::vector<double> x_;            // packed as the caller's
  std::vector<double> passed_on_;    // the x that the cliques below were computed with
  std::vector<std::int64_t> moved_;  // by row: the last solve in which passed_on_ changed
  bool solution_is_lost_ = true;
  std::int64_t num_solves_ = 0;
  std::vector<int> waiting_;  // cliques to be solved, the next one last
  AlignedVector<double> workspace_;
  std::vector<int> solved_;
  SumTree gains_;  // ½ y₁ᵀy₁ per clique
};

}  // namespace inceres::internal
