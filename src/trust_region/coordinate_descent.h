#pragma once

#include <vector>

#include "linearize/evaluator.h"
#include "trust_region/block_minimizer.h"
#include "trust_region/loop_options.h"

namespace inceres::internal {

/// Ceres's inner iterations: one round of coordinate descent. Group after group, each variable of
/// the group is moved to a minimum of the factors that see it, all others held (BlockMinimizer).
/// Variables of one group share no factor, so the order among them does not matter and they are
/// solved in parallel; the result is the same to the last bit for any number of threads.
///
/// Cost of a round: a few evaluations of the factors of each variable with its Jacobians, and for
/// each a QR factorization of their rows. Sources: Ruhe & Wedin, "Algorithms for Separable
/// Nonlinear Least Squares Problems", 1980; docs/ceres_contract.md, "Inner iterations".
class CoordinateDescent {
 public:
  /// The groups are of variables of the evaluator's layout. Descent and evaluator outlive this.
  CoordinateDescent(const InnerDescent& descent, CeresRules rules, Evaluator* evaluator);

  /// Moves the evaluator's candidate.
  void Run();

 private:
  void CollectSightings();

  const InnerDescent& descent_;
  const CeresRules rules_;
  Evaluator& evaluator_;
  std::vector<int> index_;  // per VariableId, into begin_: of those in a group, in their order
  std::vector<int> begin_;  // one more
  std::vector<Sighting> sightings_;
};

}  // namespace inceres::internal
