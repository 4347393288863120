#include "linear/bayes_tree.h"

#include <cstddef>

#include "linear/dense_panel.h"
#include "linear/front_elimination.h"
#include "linear/not_positive_definite.h"

namespace inceres::internal {

// The sparse Cholesky factor of A = S + diag that is kept clique by clique (docs/algorithms.md,
// "Reduced linear systems"; Kaess et al. 2012). Four parts share the work: TreeRows knows which
// rows and blocks of S are new, CliqueTree which rows are eliminated together, AssembledMatrix
// which values went into the factor, and TreeSubstitution what of y and x is still right. Here is
// what brings them up to date, in that order, and the elimination of a clique:
//
//     L₁ L₁ᵀ = A₁₁,    L₂ = A₂₁ L₁⁻ᵀ,    U = A₂₂ − L₂ L₂ᵀ,
//
// where A₁₁ and A₂₁ are the blocks of A in the pivots' columns and what the children's U add to
// them, and A₂₂ is what the children add beyond the pivots.
//
// A clique is stale if a block that it assembles has other values or a clique below it is stale; of
// children that are not stale the U of before is used. Stale cliques that a failed factorization
// has not reached stay stale. The order in which a front is summed follows from its rows and
// children alone, so the same calls give the same bits.

namespace {

// A held row stays in the tree. Without its blocks, and with 1 on its diagonal, nothing couples it,
// and to hold or free it costs no new order.
bool IsLeftOut(const ReducedMatrix& A, int row, int column) {
  return A.constant() != nullptr && (A.constant()[row] != 0 || A.constant()[column] != 0);
}

}  // namespace

// The pattern first, the values afterwards: a block is compared where it is assembled now. If
// memory runs out, the rows stay pending and version_ stays old, and the next call tries again.
Status BayesTree::PlanFor(const ReducedMatrix& A) {
  const SymmetricBlockRows& S = *A.rows();
  // Edits come in any order; sorted, the rows give the same tree whatever that was.
  rows_.Sort();
  if (version_ != S.version()) {
    // Offsets come first: the entries of the diagonal are looked up by them below.
    substitution_.FollowPacking(S);
    rows_.FollowPattern(S, &stale_);
    Status rebuilt = RebuildTree(S);
    if (!rebuilt.ok()) {
      return rebuilt;
    }
    version_ = S.version();
  }
  // A row that has left S has no clique. Diagonals first: where much has changed they tell of most
  // cliques, and the blocks of stale ones are not compared.
  rows_.ForEachPending([&](int row) {
    if (S.size_of(row) > 0) {
      FindChangedDiagonal(A, row);
    }
  });
  rows_.ForEachPending([&](int row) {
    if (S.size_of(row) > 0) {
      FindChangedBlocks(A, row);
    }
  });
  rows_.ForgetPending();
  flops_ = 0.0;
  for (const int c : stale_) {
    flops_ += tree_.clique(c).front.flops();
  }
  return Status::Ok();
}

// Dissolved cliques leave the lists before new ones are made, since those take over their numbers.
// New cliques are stale as they come: their arrays hold anything.
Status BayesTree::RebuildTree(const SymmetricBlockRows& S) {
  if (rows_.IsWhole()) {
    return Status::Ok();
  }
  tree_.EraseUnused(&stale_);
  substitution_.ForgetDissolved();
  Status rebuilt = rows_.Rebuild(S, &made_);
  if (rebuilt.ok()) {
    stale_.insert(stale_.end(), made_.begin(), made_.end());
    substitution_.Take(made_);
  }
  return rebuilt;
}

void BayesTree::FindChangedDiagonal(const ReducedMatrix& A, int row) {
  const SymmetricBlockRows& S = *A.rows();
  const int own = tree_.CliqueOf(row);
  if (tree_.clique(own).is_factored &&
      (!assembled_.HasDiagonal(row, A.diagonal() + substitution_.Offset(row), S.size_of(row)) ||
       !assembled_.Has(S, row, S.row(row).back(), IsLeftOut(A, row, row)))) {
    MarkStale(own);
  }
}

// Compares the values of the row's blocks off the diagonal with those in the factor, but for blocks
// of cliques that are stale already. A block lies in the columns of that of its rows which is
// eliminated first.
void BayesTree::FindChangedBlocks(const ReducedMatrix& A, int row) {
  const SymmetricBlockRows& S = *A.rows();
  const int own = tree_.CliqueOf(row);
  const auto clique_with = [&](int other) {
    return tree_.IsBefore(row, other) ? own : tree_.CliqueOf(other);
  };
  const auto differs = [&](int i, const SymmetricBlockRows::Entry& block) {
    return !assembled_.Has(S, i, block, IsLeftOut(A, i, block.column));
  };
  for (const SymmetricBlockRows::Entry& block : S.row(row)) {
    if (block.column == row) {
      continue;
    }
    const int c = clique_with(block.column);
    if (tree_.clique(c).is_factored && differs(row, block)) {
      MarkStale(c);
    }
  }
  for (const int below : S.below(row)) {
    const int c = clique_with(below);
    if (tree_.clique(c).is_factored && differs(below, {row, S.Find(below, row)})) {
      MarkStale(c);
    }
  }
}

// Children before parents, by stamp, one clique after the other; threads serve within a large
// front.
Status BayesTree::FactorizeAsPlanned(const ReducedMatrix& A) {
  work_ = Work();
  work_.factored_rows = work_.forward_rows = work_.solved_rows = 0;
  work_.factor_flops = flops_;
  tree_.SortByStamp(&stale_);
  factored_ = Status::Ok();
  std::size_t done = 0;
  for (; done < stale_.size(); ++done) {
    const int failed = Eliminate(A, stale_[done]);
    if (failed >= 0) {
      factored_ = NotPositiveDefinite(failed, &work_);
      break;
    }
    Clique& clique = tree_.clique(stale_[done]);
    clique.is_factored = true;
    work_.factored_rows += clique.num_pivots;
    // y of this clique, and so of all above, belongs to the L of before.
    substitution_.Mark(stale_[done]);
  }
  // The clique that failed is the first of those that stay.
  stale_.erase(stale_.begin(), stale_.begin() + static_cast<std::ptrdiff_t>(done));
  return factored_;
}

// Adds the blocks of A that lie in the clique's columns, and records their values in the same pass,
// so that what is compared later is what went in.
void BayesTree::Assemble(const ReducedMatrix& A, int c) {
  const SymmetricBlockRows& S = *A.rows();
  Clique& clique = tree_.clique(c);
  const Front& front = clique.front;
  place_.resize(S.num_rows());
  // Not cleared between cliques: only rows of this one are looked up.
  for (std::size_t k = 0; k < clique.rows.size(); ++k) {
    place_[clique.rows[k]] = clique.places[k];
  }
  const auto take = [&](int i, const SymmetricBlockRows::Entry& block) {
    const bool left_out = IsLeftOut(A, i, block.column);
    assembled_.Take(S, i, block, left_out);
    if (!left_out) {
      PlaceBlock(S.values(block.offset), PadToQuad(S.size_of(block.column)), S.size_of(i),
                 S.size_of(block.column), place_[i], place_[block.column], clique.L.data(),
                 front.stride());
    }
  };
  for (int k = 0; k < clique.num_pivots; ++k) {
    const int row = clique.rows[k], size = S.size_of(row);
    // A block stands with its larger row, while either row may be the one that is eliminated first.
    // Otherwise it belongs to the clique of the other row, or comes when that pivot's turn does.
    for (const SymmetricBlockRows::Entry& block : S.row(row)) {
      if (block.column == row || tree_.IsBefore(row, block.column)) {
        take(row, block);
      }
    }
    for (const int below : S.below(row)) {
      if (tree_.IsBefore(row, below)) {
        take(below, {row, S.Find(below, row)});
      }
    }
    const double* diagonal = A.diagonal() + substitution_.Offset(row);
    assembled_.TakeDiagonal(row, diagonal, size);
    // Down the diagonal: one column and one row further.
    double* pivot = clique.L.data() + place_[row] * (std::ptrdiff_t{front.stride()} + 1);
    for (int j = 0; j < size; ++j, pivot += front.stride() + 1) {
      *pivot += diagonal[j];
    }
  }
}

// The children are added in the order in which they were hung, which is a function of the edits:
// sums have one order.
int BayesTree::Eliminate(const ReducedMatrix& A, int c) {
  Clique& clique = tree_.clique(c);
  const Front& front = clique.front;
  ZeroFront(front, clique.L.data(), clique.U.data());
  Assemble(A, c);
  for (const int child : clique.children) {
    const Clique& below = tree_.clique(child);
    AddUpdateMatrix(below.front, below.U.data(), below.runs.data(),
                    static_cast<int>(below.runs.size()), front, clique.L.data(), clique.U.data());
  }
  const int failed = EliminateFront(front, clique.L.data(), clique.U.data(), executor_);
  if (failed < 0) {
    return failed;
  }
  // From the scalar pivot that failed to the row of S that it belongs to.
  int k = 0;
  while (k + 1 < clique.num_pivots && clique.places[k + 1] <= failed) {
    ++k;
  }
  return clique.rows[k];
}

// This b has to be taken up at the next solve; that x is another solver's, so that all of it is
// computed anew then.
void BayesTree::MissSolve(const Rows& changed_b) {
  substitution_.MarkChangedB(changed_b);
  substitution_.LoseSolution();
}

// What has changed in b is noted even where there is no factor: the next Solve is told of later
// changes only.
Status BayesTree::Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
                        double* x) {
  substitution_.MarkChangedB(changed_b);
  if (!factored_.ok()) {
    return factored_;
  }
  work_.forward_rows = substitution_.Forward(b);
  const std::vector<int>& solved = substitution_.Backward(truncation, x);
  work_.solved_rows = static_cast<int>(solved.size());
  work_.solved = {solved.empty() ? tree_.num_rows() : solved.front(), &solved};
  return Status::Ok();
}

// ½ bᵀA⁻¹b = ½ ‖y‖²: the substitution backwards is left out, and what it would look at stays marked
// for the next Solve.
Status BayesTree::SolveForGain(const double* b, const Rows& changed_b, double* gain) {
  substitution_.MarkChangedB(changed_b);
  if (!factored_.ok()) {
    return factored_;
  }
  work_.forward_rows = substitution_.Forward(b);
  *gain = substitution_.Gain();
  return Status::Ok();
}

std::size_t BayesTree::Bytes() const {
  return tree_.Bytes() + assembled_.Bytes() + rows_.Bytes() + substitution_.Bytes();
}

}  // namespace inceres::internal
