#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "linearisation/evaluator.h"

namespace inceres::internal {

/// Improves the landmarks of a candidate one by one with the frames held: for each the damped Gauss–Newton step
///
///     δ_l = −(P + λ diag P)⁻¹ g,   P = Σ ρ' J_lᵀJ_l,  g = Σ ρ' J_lᵀf
///
/// taken if the cost of its factors falls. Given the frames the landmarks are independent, so each is accepted or refused by
/// itself; λ of a landmark falls tenfold with a success and rises tenfold with a failure. Landmarks on a manifold or
/// with bounds, and those whose step promises too little, stay where they are.
///
/// What it is for: points seen at a small angle are strongly curved in depth, and the joint step, which sees the first order
/// only, creeps towards them for tens of iterations. Source: Jeong et al., "Pushing the Envelope of Modern Methods for Bundle
/// Adjustment", 2012 (embedded point iterations); Ceres's inner iterations.
///
/// Cost: of the landmarks' factors one evaluation with the landmark's Jacobian, and one without for those that move. The same
/// bits for any number of threads.
class InnerIterations {
 public:
  explicit InnerIterations(Evaluator* evaluator);

  /// Moves landmarks of the evaluator's candidate; returns by how much its cost fell, ≥ 0. A landmark is left alone if its step
  /// promises less than `min_gain`.
  double Run(double min_gain);

  /// Whether it is worth running after this step: asked once a step. Where the landmarks gained little beside the step they
  /// followed (Pace), they rest for a step, then for two, four, …
  bool IsDue();
  /// What a Run gained, and the step before it.
  void Pace(double gain, double step_gain);

  /// Landmarks that the last Run moved.
  int num_moved() const { return num_moved_; }
  std::int64_t Bytes() const;

 private:
  /// The factors [begin, end) of a family: neighbours that see one landmark.
  struct Stretch {
    FamilyId family;
    int begin;
    int end;
  };
  /// What a family is evaluated with when only landmarks move. A factor sees one landmark at most, so that its slots share the
  /// memory of one Jacobian, rows four apart.
  struct LandmarkJacobians {
    std::vector<const TangentMap*> maps;  // per factor and slot
    AlignedVector<double> values;
    std::vector<JacobianView> views;  // per slot
  };
  struct NormalEquations {
    double P[kQuad * kQuad] = {};  // rows four apart
    double g[kQuad] = {};
    double cost = 0.0;
  };

  void BuildJacobians(const FamilyCache& cache);
  void BuildStretches();
  double Improve(int landmark, double min_gain);
  bool Evaluate(const Stretch& stretch, bool jacobians);
  bool Linearise(int landmark, NormalEquations* equations);
  double Cost(int landmark);
  void Accumulate(const FamilyCache& cache, int factor, int size, NormalEquations* equations) const;

  Evaluator& evaluator_;
  const Layout& layout_;
  TangentMap constant_;
  TangentMap unwanted_;
  std::vector<TangentMap> identity_;          // per size
  std::vector<LandmarkJacobians> jacobians_;  // per family
  std::vector<int> stretches_begin_;          // per landmark, one more
  std::vector<Stretch> stretches_;
  std::vector<double> damping_;  // λ per landmark
  std::vector<double> gains_;    // of the last Run, per landmark
  int num_moved_ = 0;
  int rest_ = 0;   // steps that the last rest lasted
  int to_go_ = 0;  // of it
};

}  // namespace inceres::internal
