#pragma once

#include <cstdint>
#include <vector>

#include "incremental/incremental_schur.h"
#include "linear/bayes_tree.h"
#include "linear/live_factor.h"
#include "linear/pending_rows.h"
#include "linear/tip_marginal.h"

namespace inceres::internal {

/// A factor of S without damping, beside the one that steps are found with, for covariances: a
/// Bayes tree of which a call of Follow renews the cliques whose blocks have changed, unless these
/// are so few that products find their way around them (PendingRows). Nothing is done, and next to
/// nothing held, until it is asked for.
class UndampedFactor {
 public:
  explicit UndampedFactor(const Executor& executor) : tree_(executor) {}

  /// Which rows of S have changed since: to be called before the others.
  void NoteChanges(IncrementalSchur* schur);
  /// Whether this row is the one at which the problem grows, and its marginal known by that.
  bool KnowsMarginalOf(int row) const { return tip_.Knows(row); }
  const TipMarginal::Block& marginal() const { return tip_.sigma(); }
  /// What came of Product for one row, which may be the one at which the problem will grow.
  void Remember(const IncrementalSchur& schur, int row, const Eigen::MatrixXd& marginal);

  /// kSingular: S is not definite, for example because the gauge is free. `whole`: nothing may be
  /// left pending. `num_factored`: frames.
  Status Follow(const IncrementalSchur& schur, bool whole, int* num_factored);
  /// Of the S that Follow has seen last, as LiveFactor has it. kUnavailable: it is to be followed
  /// as a whole.
  Status Product(const SparseColumns& V, const std::vector<int>& offsets,
                 Eigen::MatrixXd* product) const {
    return waiting_.empty() ? LiveFactor(tree_).Product(V, offsets, product)
                            : pending_.Product(V, offsets, tree_.tree(), product);
  }
  /// Of what was followed as a whole.
  const BayesTree& tree() const { return tree_; }

 private:
  bool MayWait(const IncrementalSchur& schur);
  void TakeUpRow(const IncrementalSchur& schur, int row);
  bool KeepsPacking(const IncrementalSchur& schur) const;
  Status Factorize(const IncrementalSchur& schur);

  BayesTree tree_;
  PendingRows pending_;
  TipMarginal tip_;
  bool is_new_ = true;
  Status factored_;                    // the last time
  std::int64_t num_released_ = 0;      // blocks of S, then
  std::vector<std::int32_t> changed_;  // the last that NoteChanges was told, ascending
  std::vector<std::int32_t> waiting_;  // have changed since S was factored, ascending
  bool is_taken_up_ = true;            // what waits, by pending_
  std::vector<std::int32_t> scratch_;
  std::vector<int> sizes_;        // of the rows that were taken up
  std::vector<double> diagonal_;  // packed by rows
  std::vector<char> constant_;
};

}  // namespace inceres::internal
