#pragma once

#include <vector>

#include "linear/block_rows.h"
#include "linear/row_order.h"

namespace inceres::internal {

/// held may be null: none is.
inline bool IsHeld(const char* held, int row) {
  return held != nullptr && held[row] != 0;
}

/// The first place whose row of S is coupled to the row at place k, held rows left out (held may be
/// null); k itself if none before it is.
int FirstFreeColumn(const SymmetricBlockRows& S, const char* held, const RowOrder& order, int k);

/// What rows of a factor take, and how many entries they have, those of the diagonal blocks by
/// halves.
struct RowWork {
  double flops = 0.0;
  double entries = 0.0;
};

/// Of the rows [begin, end) of a Cholesky factor whose block row i begins in block column first[i];
/// offset[i] is its first scalar row, of all up to offset[end].
RowWork WorkOfRows(const int* first, const int* offset, int begin, int end);

/// Of the rows that EnvelopeCholesky computes from first_place on. Cost: one operation a block that
/// those rows span; no allocation beyond the growth of the workspace.
RowWork EnvelopeWork(const SymmetricBlockRows& S, const char* held, const RowOrder& order,
                     int first_place, std::vector<int>* workspace);

/// An order of the rows from some place on that keeps the envelope small, for when the order as it
/// is has aged (old frames seen again). The given rows come last, in the order they have, so that a
/// change like theirs finds the end of the factor; the others by their distance from those in S
/// (Cuthill-McKee, reversed). A row coupled to very many (shared intrinsics) comes after all: there
/// it lengthens its own row only. Compare by EnvelopeWork: it need not be better.
///
/// Cost: that of sorting the neighbors of every row. Deterministic; no allocation beyond the growth
/// of what it keeps. Source: Cuthill & McKee 1969; George & Liu 1981, chapter 4.
class EnvelopeOrdering {
 public:
  /// The rows that have the places from first_place on, in their new order. `last`: at least one of
  /// them, or, if none of it is, the newest row; rows that have no such place are passed over.
  const std::vector<int>& Reorder(const SymmetricBlockRows& S, const RowOrder& order,
                                  int first_place, const std::vector<int>& last);

 private:
  void Begin(const SymmetricBlockRows& S, const RowOrder& order, int first_place);
  void TakeDenseRows(const SymmetricBlockRows& S, const RowOrder& order, int first_place);
  void TakeConnected(const SymmetricBlockRows& S);
  void Take(int row);

  std::vector<char> taken_;  // per row of S; rows before the first place are taken from the start
  std::vector<int> rows_;    // backwards, from the last place
  std::size_t next_ = 0;     // the row of rows_ whose neighbors come next
  std::vector<int> near_;
  std::vector<int> last_places_;
};

}  // namespace inceres::internal
