#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "base/zeroed_array.h"
#include "linearize/evaluator.h"

namespace inceres::internal {

/// Improves the landmarks of a candidate one by one with the frames held: for each the damped
/// Gauss–Newton step
///
///     δ_l = −(P + λD)⁻¹ g,   P = Σ ρ' J_lᵀJ_l,  g = Σ ρ' J_lᵀf,   D: LandmarkDampingScale
///
/// taken if the cost of its factors falls. Given the frames the landmarks are independent, so each
/// is accepted or refused by itself; λ of a landmark falls tenfold with a success and rises tenfold
/// with a failure. Landmarks on a manifold or with bounds, and those whose step promises too
/// little, stay where they are.
///
/// What it is for: points seen at a small angle are strongly curved in depth, and the joint step,
/// which sees the first order only, creeps toward them for tens of iterations. Source: Jeong et
/// al., "Pushing the Envelope of Modern Methods for Bundle Adjustment", 2012 (embedded point
/// iterations); Ceres's inner iterations.
///
/// Cost: of the factors of the landmarks asked one evaluation with the landmark's Jacobian, and one
/// without for those that move, in runs of neighbors, as families like it best. Of many landmarks
/// every eighth is asked first, each time another eighth, and the others only where the gain of
/// these lets expect that they are worth it. The same bits for any number of threads.
class InnerIterations {
 public:
  explicit InnerIterations(Evaluator* evaluator);

  /// Moves landmarks of the evaluator's candidate; returns by how much its cost fell, ≥ 0. A
  /// landmark is left alone if its step promises less than `min_gain`. What the step gained that
  /// led to the candidate tells what would be worth it; with 0 all landmarks are asked.
  double Run(double min_gain, double step_gain = 0.0);

  /// Whether it is worth running after a step that gained this much: asked once a step. It is while
  /// steps creep, each gaining more than a fifth of what the last one that gained did. Where the
  /// landmarks gained little beside the step they followed (Pace), they rest for a step, then for
  /// two, four, …
  bool IsDue(double step_gain);
  /// What a Run gained, and the step before it. Where that was worth it, the next Run asks only the
  /// landmarks that brought it: those that creep are few. As soon as they gain little, it asks all
  /// again.
  void Pace(double gain, double step_gain);

  /// Landmarks that the last Run moved.
  int num_moved() const { return num_moved_; }
  std::int64_t Bytes() const;

 private:
  /// The factors of a family that see one landmark: a part of sightings_.
  struct Group {
    FamilyId family;
    int begin;
    int end;
  };
  /// What a family is evaluated with when only landmarks move. A factor sees one landmark at most,
  /// so that its slots share the memory of one Jacobian, rows four apart.
  struct LandmarkJacobians {
    std::vector<std::int32_t> landmarks;  // per factor, -1: none that could move
    std::vector<const TangentMap*> maps;  // per factor and slot
    ZeroedArray values;               // of those that are never asked the memory is never touched
    std::vector<JacobianView> views;  // per slot
    SlotJacobians blocks;             // the same, as kernels call them
  };
  struct SlotUse {
    const TangentMap* map;
    std::int32_t landmark;
  };
  struct NormalEquations {
    alignas(32) double P[kQuad * kQuad] = {};  // rows four apart
    double eta[kQuad] = {};                    // −g
    double cost = 0.0;
  };

  /// What becomes of a landmark in a Run.
  struct Trial {
    double cost = 0.0;    // of its factors, before
    double start[kQuad];  // its values then
    double gain = 0.0;
    bool moves = false;
  };

  void RunChosen(double min_gain);
  double SumOfGains() const;
  std::vector<SlotUse> FindUses() const;
  void BuildJacobians(const std::vector<SlotUse>& uses, const Linearization& cache);
  void BuildGroups();
  template <typename Selected>
  void Evaluate(bool jacobians, const Selected& selected);
  void EvaluateRun(FamilyId family, int begin, int end, bool jacobians);
  void Propose(int landmark, double min_gain);
  void Judge(int landmark);
  double Cost(int landmark) const;
  void Accumulate(const Group& group, int size, NormalEquations* equations);
  double* Values(int landmark);

  Evaluator& evaluator_;
  const Layout& layout_;
  const Kernels& kernels_;
  TangentMap constant_;
  TangentMap unwanted_;
  std::vector<TangentMap> identity_;          // per size
  std::vector<LandmarkJacobians> jacobians_;  // per family
  std::vector<int> groups_begin_;             // per landmark, one more
  std::vector<Group> groups_;
  std::vector<std::int32_t> sightings_;
  std::vector<double> damping_;  // λ per landmark
  std::vector<Trial> trials_;    // of the last Run, per landmark
  std::vector<char> chosen_;     // per landmark: whether the next Run asks it
  bool all_are_chosen_ = true;
  int next_sample_ = 0;  // the landmark that a sample begins with
  int num_moved_ = 0;
  double last_step_gain_ = HUGE_VAL;  // the first step does not creep
  int rest_ = 0;                      // steps that the last rest lasted
  int to_go_ = 0;                     // of it
};

}  // namespace inceres::internal
