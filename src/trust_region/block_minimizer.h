#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "linearize/evaluator.h"
#include "linearize/tangent.h"
#include "trust_region/loop_options.h"

namespace inceres::internal {

/// A place of a variable: slot `slot` of a factor.
struct Sighting {
  FamilyId family;
  std::int32_t factor;
  std::int32_t slot;
};

/// Minimizes the cost of the factors that see one variable over that variable, with all others held
/// where the evaluator's candidate has them: Levenberg–Marquardt with Ceres's default options, its
/// stopping rules and a QR factorization of the damped rows for each step, as Ceres solves the
/// block problems of its inner iterations. Where the problem cannot be evaluated the variable stays
/// at the best values found so far.
///
/// Memory is kept from variable to variable. One thread each; several may work at a time on
/// variables that share no factor. Source: Madsen, Nielsen & Tingleff, "Methods for Non-linear
/// Least Squares Problems", 2004, algorithm 3.16.
class BlockMinimizer {
 public:
  /// `asks_as_ceres`: InnerDescent::asks_as_ceres. `last`: one after the last of all sightings,
  /// those of variables one after the other in the order in which they are minimized most likely.
  BlockMinimizer(CeresRules rules, bool asks_as_ceres, const Sighting* last, Evaluator* evaluator);

  /// Moves the variable in the evaluator's candidate. `begin` to `end`: where it stands.
  void Minimize(VariableId id, const Sighting* begin, const Sighting* end);

 private:
  void Take(VariableId id, const Sighting* begin, const Sighting* end);
  // What cost functions are asked for.
  enum class Asked {
    kCosts,
    kOwnJacobians,
    kAllJacobians,  // others' too, where they are kept
  };

  bool Linearize(Asked asked);
  bool EvaluateJacobians(Asked asked, const std::vector<double>& x, double* cost);
  bool EvaluateCandidate(double* cost);
  bool Evaluate(Asked asked, double* cost);
  void AskForJacobians(Asked asked, const Sighting& sighting, int row, FactorBatch* batch);
  bool Robustify(const Sighting& sighting, int row, bool jacobians, double* cost);
  void FormColumns();
  bool ProjectedGradientIsSmall();
  bool MoveFromCurrent(const double* step);
  bool ComputeStep();
  bool TryStep(bool* successful);
  void ShrinkRadius();

  const Sighting* const last_;
  Evaluator& evaluator_;
  const FactorGraph& graph_;
  const bool infinite_cost_is_failure_;
  const bool asks_as_ceres_;

  VariableId id_ = -1;
  const Sighting* begin_ = nullptr;
  const Sighting* end_ = nullptr;
  double* values_ = nullptr;  // of the variable in the candidate
  int size_ = 0;              // tangent
  int num_rows_ = 0;
  Tangent tangent_;
  // per slot of a factor
  std::vector<JacobianView> views_;
  std::vector<const TangentMap*> maps_;
  TangentMap constant_;
  TangentMap unwanted_;
  AlignedVector<double> rows_;       // J row by row, padded to quads
  AlignedVector<double> columns_;    // [J f], zeros below
  AlignedVector<double> reflected_;  // [J f; √Λ 0]
  std::vector<double> f_;
  std::vector<double> H_;  // of [J f], negative, the last row is the gradient
  std::vector<double> scale_;
  std::vector<double> step_;
  std::vector<double> scratch_;
  std::vector<double> current_;
  std::vector<double> candidate_;
  std::vector<double> best_;
  double cost_ = 0.0;
  double best_cost_ = 0.0;
  double model_decrease_ = 0.0;
  double state_norm_ = -1.0;  // unknown until a step was accepted
  double radius_ = 0.0;
  double decrease_factor_ = 2.0;
};

}  // namespace inceres::internal
