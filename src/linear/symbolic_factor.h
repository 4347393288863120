#pragma once

#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "inceres/status.h"

namespace inceres::internal {

/// An order of the block rows of S in which its Cholesky factor has few entries, and where these
/// are: columns of nearly the same rows are one front. A position is a block's place in the order.
/// Everything counts blocks of the mean size.
struct SymbolicFactor {
  // block of S, by position; every subtree of the elimination tree in one piece
  std::vector<int> order;
  // first position of each front's pivots, and one more: the number of blocks
  std::vector<int> front_begin;
  std::vector<int> row_begin;  // of each front, and one more: its rows are rows[row_begin[f]] on
  std::vector<int> rows;       // positions, ascending, the pivots first
  double flops = 0.0;          // of the factorization, before columns are joined to fronts
  bool dissected = false;
};

/// Orders the blocks by AMD (Amestoy, Davis & Duff, ACM TOMS 30(3), 2004), or by AMD in the parts
/// between small separators, which METIS finds, where that takes hardly more flops: of a small S in
/// two halves, for the threads, which is left out without `may_dissect`; of one whose factorization
/// takes longer than that, in many. With groups of the pattern by constrained AMD, without
/// separators. kUnavailable when out of memory. Cost: about half a microsecond a block of S, twice
/// that where there are many parts. Sources: George, "Nested Dissection of a Regular Finite Element
/// Mesh", SIAM J. Numer. Anal. 10(2), 1973; Liu, "The Role of Elimination Trees in Sparse
/// Factorization", SIAM J. Matrix Anal. Appl. 11(1), 1990; Ashcraft & Grimes, "The Influence of
/// Relaxed Supernode Partitions on the Multifrontal Method", ACM TOMS 15(4), 1989; Chen, Davis,
/// Hager & Rajamanickam, "Algorithm 887: CHOLMOD", ACM TOMS 35(3), 2008 (the rule by which columns
/// are joined).
Status FindSymbolicFactor(const BlockPattern& pattern, bool may_dissect, SymbolicFactor* factor);

/// The fronts of a given order, which becomes a postorder of its elimination tree. In a row of the
/// pattern blocks may come in any order, and twice, but for the diagonal one, which is last.
void FindFronts(const BlockPattern& pattern, const std::vector<int>& order, SymbolicFactor* factor);

}  // namespace inceres::internal
