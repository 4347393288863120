#include "linear/tree_rows.h"

#include <algorithm>

#include "base/growth_count.h"
#include "linear/resuming.h"
#include "simd/kernels.h"

namespace inceres::internal {

// What the Bayes tree knows of the structure of S (docs/algorithms.md, "Reduced linear systems",
// Bayes tree). Changes of S are told as rows; which block is new, or has gone, is found by
// comparing a row's neighbors with those that it had when it was last looked at. Three cases:
//
// - A row or a block that has gone: the row leaves the tree, all cliques that know it dissolve, and
//   it comes back as a new one if it is still there.
// - A block where the factor has a place (fill-in): the clique that assembles it is stale, and the
//   tree stays.
// - Any other block, or a row that is new: the cliques of its rows and those above dissolve.
//
// Neighbors are known from both ends, so that a change that is told of one row only is known of the
// other. Pending rows stay pending until ForgetPending: what fails halfway is done again.

namespace {

// Rows ahead of it, then rows behind it: ascending, since each part is.
void ListNeighbors(const SymmetricBlockRows& S, int row, std::vector<int>* neighbors) {
  neighbors->clear();
  S.ForEachCoupled(row, [&](int other) {
    if (other != row) {
      neighbors->push_back(other);
    }
  });
}

// Adds to, or takes from, an ascending list.
void AddTo(std::vector<int>* list, int value) {
  const auto at = std::lower_bound(list->begin(), list->end(), value);
  if (at == list->end() || *at != value) {
    list->insert(at, value);
  }
}
void TakeFrom(std::vector<int>* list, int value) {
  const auto at = std::lower_bound(list->begin(), list->end(), value);
  if (at != list->end() && *at == value) {
    list->erase(at);
  }
}

std::size_t LengthOf(const SymmetricBlockRows& S, int row, int column) {
  return static_cast<std::size_t>(S.size_of(row)) * PadToQuad(S.size_of(column));
}

}  // namespace

// A row is pending once, however often it is told.
void TreeRows::Follow(const SymmetricBlockRows& S, const ReducedSolver::Rows& changed) {
  rows_.resize(std::max(rows_.size(), static_cast<std::size_t>(S.num_rows())));
  ForEachRow(changed, S.num_rows(), [this](int row) {
    if (!rows_[row].is_pending) {
      rows_[row].is_pending = true;
      pending_.push_back(row);
    }
  });
}

// What has gone first, so that a row that left and came back as another is new when new blocks are
// looked at.
void TreeRows::FollowPattern(const SymmetricBlockRows& S, std::vector<int>* stale) {
  touched_.clear();
  ForgetLostRows(S);
  TakeUpNewBlocks(S, stale);
}

// The neighbors forget the row as well: otherwise they would look for a block that nobody has.
void TreeRows::Forget(int row) {
  for (const int neighbor : rows_[row].neighbors) {
    TakeFrom(&rows_[neighbor].neighbors, row);
  }
  rows_[row].neighbors.clear();
  // A row that still waits for its place (Rebuild) is in no clique.
  if (tree_.Has(row)) {
    tree_.Remove(row);
  }
}

// A row that has gone, or has come back as another, or without a block that it had, or in another
// group: then all that know it are ordered anew.
// The comparison of values would not show it: it visits the blocks that S has.
void TreeRows::ForgetLostRows(const SymmetricBlockRows& S) {
  for (const int row : pending_) {
    ListNeighbors(S, row, &neighbors_);
    const std::vector<int>& known = rows_[row].neighbors;
    // Both lists ascend.
    if ((tree_.Has(row) &&
         (S.size_of(row) != tree_.SizeOf(row) || S.group_of(row) != tree_.GroupOf(row))) ||
        !std::includes(neighbors_.begin(), neighbors_.end(), known.begin(), known.end())) {
      Forget(row);
    }
    // It may have left S while it was waiting.
    if (S.size_of(row) == 0) {
      TakeFrom(&new_rows_, row);
    }
  }
}

// Only edges that are not known are taken up, each from the first of its rows that is looked at.
void TreeRows::TakeUpNewBlocks(const SymmetricBlockRows& S, std::vector<int>* stale) {
  for (const int row : pending_) {
    if (S.size_of(row) == 0) {
      continue;
    }
    if (!tree_.Has(row)) {
      AddTo(&new_rows_, row);
    }
    ListNeighbors(S, row, &neighbors_);
    if (neighbors_ == rows_[row].neighbors) {
      continue;
    }
    for (const int other : neighbors_) {
      // Looked up anew each time: where the other row was taken up before, it has entered itself
      // here.
      const std::vector<int>& known = rows_[row].neighbors;
      if (!std::binary_search(known.begin(), known.end(), other)) {
        TakeUpNeighbor(row, other, stale);
      }
    }
    const GrowthCount growth(rows_[row].neighbors, &list_bytes_);
    rows_[row].neighbors = neighbors_;
  }
}

// The block is new. Where the factor has a place for it the tree may stay as it is.
void TreeRows::TakeUpNeighbor(int row, int other, std::vector<int>* stale) {
  const GrowthCount growth(rows_[other].neighbors, &list_bytes_);
  AddTo(&rows_[other].neighbors, row);
  touched_.push_back(row);
  touched_.push_back(other);
  const bool both = tree_.Has(row) && tree_.Has(other);
  if (both && tree_.AreCoupled(row, other)) {
    // A block is assembled with the row that is eliminated first.
    tree_.ClearUpwards(tree_.CliqueOf(tree_.IsBefore(row, other) ? row : other),
                       &Clique::is_factored, stale);
    return;
  }
  // A row that is new has no clique; it is ordered with what its neighbors' cliques leave.
  for (const int end : {row, other}) {
    if (tree_.Has(end)) {
      tree_.Dissolve(end);
    }
  }
}

// New rows come last in the order, or, where none is new, the rows with a new block. If memory runs
// out, new_rows_ stay for the next try.
Status TreeRows::Rebuild(const SymmetricBlockRows& S, std::vector<int>* made) {
  Status rebuilt = tree_.Rebuild(S, new_rows_, new_rows_.empty() ? touched_ : new_rows_, made);
  if (rebuilt.ok()) {
    new_rows_.clear();
  }
  return rebuilt;
}

// AssembledMatrix: a copy of the values of S and of its diagonal as they were assembled into a
// factor. The Bayes tree (docs/algorithms.md, "Reduced linear systems") asks block by block what
// has become another since, and only what has makes a clique stale. The comparison is one of
// values: a row that was summed anew with the same result costs nothing. An entry that is NaN is
// unlike itself and so always counts as changed, which is the safe side.
//
// The copy has the layout of SymmetricBlockRows, offset by offset, padding included. Where a block
// takes up the room of a removed one, the copy has the values of the latter until Take. So of each
// room it is known which block they are of: two blocks that went and came back may have traded
// their rooms, and the neighbors of their rows tell nothing of it.

// Beyond the end of the copy nothing has been taken yet. The values of another block count for
// nothing, even where they are the same. A block that is left out (a held row) stands for zeros, so
// that holding and freeing a row shows as a change of its blocks.
bool AssembledMatrix::Has(const SymmetricBlockRows& S, int row,
                          const SymmetricBlockRows::Entry& block, bool left_out) const {
  const std::size_t length = LengthOf(S, row, block.column);
  if (values_.size() < static_cast<std::size_t>(block.offset) + length) {
    return false;
  }
  const Name& name = names_[block.offset / kQuad];
  if (name.row != row || name.column != block.column) {
    return false;
  }
  const double* taken = values_.data() + block.offset;
  return left_out ? std::all_of(taken, taken + length, [](double value) { return value == 0.0; })
                  : std::equal(taken, taken + length, S.values(block.offset));
}

void AssembledMatrix::Take(const SymmetricBlockRows& S, int row,
                           const SymmetricBlockRows::Entry& block, bool left_out) {
  const std::size_t length = LengthOf(S, row, block.column);
  const auto end = static_cast<std::size_t>(block.offset) + length;
  if (values_.size() < end) {
    names_.resize(end / kQuad);
    values_.resize(end);
  }
  names_[block.offset / kQuad] = {row, block.column};
  // Whole quads, of a block that is mostly too small for a library call to be worthwhile.
  double* const taken = values_.data() + block.offset;
  const double* const values = S.values(block.offset);
  for (std::size_t k = 0; k < length; k += kQuad) {
    for (std::size_t i = k; i < k + kQuad; ++i) {
      taken[i] = left_out ? 0.0 : values[i];
    }
  }
}

// By rows of S, since a row's damping may change where its blocks do not. A row that was taken with
// another size is unequal by its length.
bool AssembledMatrix::HasDiagonal(int row, const double* diagonal, int size) const {
  return row < static_cast<int>(diagonals_.size()) &&
         std::equal(diagonals_[row].begin(), diagonals_[row].end(), diagonal, diagonal + size);
}

void AssembledMatrix::TakeDiagonal(int row, const double* diagonal, int size) {
  if (row >= static_cast<int>(diagonals_.size())) {
    diagonals_.resize(static_cast<std::size_t>(row) + 1);
  }
  const GrowthCount growth(diagonals_[row], &list_bytes_);
  diagonals_[row].assign(diagonal, diagonal + size);
}

std::size_t AssembledMatrix::Bytes() const {
  return values_.capacity() * sizeof(double) + names_.capacity() * sizeof(Name) +
         diagonals_.size() * sizeof(std::vector<double>) + list_bytes_;
}

}  // namespace inceres::internal
