#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "inceres/status.h"
#include "linear/block_rows.h"
#include "linear/clique_tree.h"

namespace inceres::internal {

/// How a Bayes tree follows the rows and blocks of an S that is edited: which rows have changed
/// since it was last looked at, and which blocks each had then. A row that has gone, or a block,
/// leaves the tree; one that is new dissolves the cliques it reaches, but where the factor has a
/// place for it. Cost: what has changed, and its neighbors.
class TreeRows {
 public:
  /// The tree belongs to who factors it, and stays where it is.
  explicit TreeRows(CliqueTree* tree) : tree_(*tree) {}

  /// Remembers what has changed.
  void Follow(const SymmetricBlockRows& S, const ReducedSolver::Rows& changed);
  void Sort() { std::sort(pending_.begin(), pending_.end()); }
  /// S has another pattern: the tree is as it was where that leaves it, and cliques that have a
  /// block more join the stale ones with those above them.
  void FollowPattern(const SymmetricBlockRows& S, std::vector<int>* stale);
  /// Whether S had this block when it was last looked at, off the diagonal or on it.
  bool Knows(int row, int column) const {
    if (row == column || !tree_.Has(row)) {
      return tree_.Has(row);
    }
    const std::vector<int>& known = rows_[static_cast<std::size_t>(row)].neighbors;
    return std::binary_search(known.begin(), known.end(), column);
  }
  /// Whether the tree lacks no row.
  bool IsWhole() const { return tree_.IsWhole() && new_rows_.empty(); }
  /// CliqueTree::Rebuild with what was taken up.
  Status Rebuild(const SymmetricBlockRows& S, std::vector<int>* made);
  /// Calls visit(row) of what has changed.
  template <typename Visit>
  void ForEachPending(const Visit& visit) const {
    std::for_each(pending_.begin(), pending_.end(), visit);
  }
  void ForgetPending() {
    ForEachPending([this](int row) { rows_[static_cast<std::size_t>(row)].is_pending = false; });
    pending_.clear();
  }

  std::size_t Bytes() const { return rows_.capacity() * sizeof(Row) + list_bytes_; }

 private:
  // What is kept of a row of S.
  struct Row {
    std::vector<int> neighbors;  // rows that it has a block with, ascending
    bool is_pending = false;
  };

  void Forget(int row);
  void ForgetLostRows(const SymmetricBlockRows& S);
  void TakeUpNewBlocks(const SymmetricBlockRows& S, std::vector<int>* stale);
  void TakeUpNeighbor(int row, int other, std::vector<int>* stale);

  CliqueTree& tree_;
  std::vector<Row> rows_;
  std::size_t list_bytes_ = 0;  // of their neighbors
  std::vector<int> pending_;    // rows that have changed, and were not looked at since
  std::vector<int> neighbors_;  // workspace
  std::vector<int> new_rows_;
  std::vector<int> touched_;  // rows with a new block
};

/// The A = S + diag that a factor was made of, block by block, for who wants to know what has
/// become another since: to the bit, so that rows that were only summed anew do not count. A block
/// that has come to the room of another one is not it, whatever its values are.
class AssembledMatrix {
 public:
  /// A block that is left out counts as zeros.
  bool Has(const SymmetricBlockRows& S, int row, const SymmetricBlockRows::Entry& block,
           bool left_out) const;
  void Take(const SymmetricBlockRows& S, int row, const SymmetricBlockRows::Entry& block,
            bool left_out);
  /// A block that was taken, padded as S has it.
  const double* Values(std::int64_t offset) const { return values_.data() + offset; }
  /// The row's `size` entries of the diagonal.
  bool HasDiagonal(int row, const double* diagonal, int size) const;
  void TakeDiagonal(int row, const double* diagonal, int size);
  std::size_t Bytes() const;

 private:
  struct Name {
    int row = -1;
    int column = -1;
  };

  std::vector<double> values_;  // where S has them
  std::vector<Name> names_;     // per quad of these: at the first of a block, the block
  std::vector<std::vector<double>> diagonals_;
  std::size_t list_bytes_ = 0;  // of these
};

}  // namespace inceres::internal
