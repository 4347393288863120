#pragma once

#include <vector>

#include "block/block_rows.h"

namespace inceres::internal {

/// The first block row that block row i of S is coupled to, held rows left out (held may be null); i itself if there is none.
int FirstFreeColumn(const SymmetricBlockRows& S, const char* held, int i);

/// Flops that EnvelopeCholesky takes for the block rows from first_row on. Cost: one operation a block that those rows span; no
/// allocation beyond the growth of the workspace.
double EnvelopeFlops(const SymmetricBlockRows& S, const char* held, int first_row, std::vector<int>* workspace);
inline double EnvelopeFlops(const SymmetricBlockRows& S, const char* held, int first_row) {
  std::vector<int> workspace;
  return EnvelopeFlops(S, held, first_row, &workspace);
}

/// The same for all rows, if the rows were in this order: order[k] is the row that comes k-th. Rows not listed are left out.
double EnvelopeFlops(const SymmetricBlockRows& S, const std::vector<int>& order);

/// An order of the living rows that keeps the envelope small, for when the order of arrival has aged (old frames seen again):
/// order[k] is the row that comes k-th. The num_newest ≥ 1 newest rows come last, as they arrived, so that the next changes find
/// the end of the factor; the others by their distance from them in S (Cuthill-McKee, reversed). A row coupled to very many
/// (shared intrinsics) comes after all: there it lengthens its own row only. Compare with the order as it is by EnvelopeFlops: it
/// need not be better.
///
/// Cost: that of sorting the neighbours of every row. Deterministic. Source: Cuthill & McKee 1969; George & Liu 1981, chapter 4.
std::vector<int> EnvelopeOrder(const SymmetricBlockRows& S, int num_newest);

}  // namespace inceres::internal
