#pragma once

#include <cstdint>
#include <vector>

#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"
#include "linear/bayes_tree.h"

namespace inceres::internal {

/// A factor of S without damping, beside the one that steps are found with, for covariances: a
/// Bayes tree of which a call of Follow renews the cliques whose blocks have changed. Nothing is
/// done, and next to nothing held, until it is asked for.
class UndampedFactor {
 public:
  explicit UndampedFactor(const Executor& executor) : tree_(executor) {}

  /// kSingular: S is not definite, for example because the gauge is free. `num_factored`: frames.
  Status Follow(IncrementalSchur* schur, int* num_factored);
  ReducedSolver* solver() { return &tree_; }

 private:
  void TakeUpRow(const IncrementalSchur& schur, int row);
  bool KeepsPacking(const IncrementalSchur& schur) const;

  BayesTree tree_;
  bool is_new_ = true;
  Status factored_;  // the last time
  std::vector<std::int32_t> changed_;
  std::vector<int> sizes_;        // of the rows that were taken up
  std::vector<double> diagonal_;  // packed by rows
  std::vector<char> constant_;
};

}  // namespace inceres::internal
