#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "base/aligned_vector.h"
#include "inceres/graph/factor_graph.h"
#include "linearisation/live_family.h"
#include "linearisation/live_tangents.h"
#include "linearisation/live_values.h"
#include "schur/index_set.h"
#include "schur/live_schur.h"

namespace inceres::internal {

/// A growing problem with everything that was ever computed for it: values, cached linearisations, S and b. What an incremental
/// strategy drives:
///
///     TakeUpAdditions -> Relinearise -> (solve S' δ_c = b elsewhere) -> SetFrameStep, Visit -> EvaluateStep -> Accept or Reject
///
/// The cost of each verb goes with the factors it touches, not with the size of the problem.
/// Threads: the calling one. Source: algorithms.md section 2 (the thesis's algorithms 2 to 4).
class LiveSystem {
 public:
  /// The graph grows at its owner's hands; its state vector is read once, when a variable is taken up.
  explicit LiveSystem(const FactorGraph& graph) : graph_(graph), schur_(&families_) {}
  LiveSystem(const LiveSystem&) = delete;
  LiveSystem& operator=(const LiveSystem&) = delete;

  /// Variables and factors the graph has gained since the last call; the new factors are dirty. Requires a graph that validates.
  void TakeUpAdditions();

  /// Marks a factor for relinearisation.
  void MarkDirty(FactorRef ref) { dirty_[ref.family].Add(ref.factor); }
  /// Marks a landmark for elimination anew, to take up another damping.
  void Redamp(std::int32_t landmark);

  /// Algorithm 3: takes the old contributions of the dirty subgraph out of S and b, linearises its factors at the current values
  /// and puts the new ones in; its landmarks are damped by lambda · diag(P). On failure names the factor or variable; S and b are
  /// then incomplete.
  Status Relinearise(double lambda);

  /// The step under construction; what is not set does not move.
  void SetFrameStep(std::int32_t frame, const double* step);
  /// Back-substitutes a landmark from the frame steps set so far.
  void Visit(std::int32_t landmark);

  /// Evaluates the step: change of the cost, and the decrease the linearisations predict, over the factors it touches.
  Status EvaluateStep(double* change, double* predicted_decrease);
  /// Ends the step: the values move, and residuals, gradient shares and b follow; Jacobians stay. Or nothing moves.
  void Accept() {
    AcceptValues();
    EndStep();
  }
  void Reject();
  /// Accept in two halves, for whoever wants to look at the touched factors in between.
  void AcceptValues();
  void EndStep();

  bool FrameMoves(std::int32_t frame) const { return moved_.Has(frame); }
  int NumDirtyFactors() const;
  /// Landmarks eliminated since the last call.
  int TakeNumEliminated() { return std::exchange(num_eliminated_, 0); }

  /// Calls visit(ref) for each factor the step touches; between EvaluateStep and Accept or Reject.
  template <typename Visit>
  void ForEachTouched(Visit&& visit) const {
    for (const LiveFamily& family : families_) {
      for (const std::int32_t i : touched_[family.id()].indices()) {
        visit(FactorRef{family.id(), i});
      }
    }
  }

  double cost() const { return cost_; }
  const LiveValues& values() const { return values_; }
  const std::vector<LiveFamily>& families() const { return families_; }
  LiveSchur& schur() { return schur_; }
  const LiveSchur& schur() const { return schur_; }

 private:
  void TakeUpVariables();
  Status LineariseFamily(LiveFamily* family);
  void Move(VariableId id, std::int32_t quad, const std::vector<FactorRef>& factors);

  const FactorGraph& graph_;
  LiveValues values_;
  LiveTangents tangents_;
  std::vector<LiveFamily> families_;
  LiveSchur schur_;
  std::vector<int> frame_of_;     // per variable, or -1
  std::vector<int> landmark_of_;  // per variable, or -1
  double cost_ = 0.0;
  int num_eliminated_ = 0;

  std::vector<IndexSet> dirty_;       // per family: to be relinearised
  std::vector<IndexSet> touched_;     // per family: with a variable that moves
  std::vector<IndexSet> linearised_;  // per family: whose Jacobian is part of S
  IndexSet dirty_landmarks_;          // out of S, to be eliminated anew
  IndexSet stale_landmarks_;          // within Accept: whose right-hand side has changed
  IndexSet visited_;
  IndexSet moved_;
  AlignedVector<double> step_;  // padded, all variables; zero where nothing moves
};

}  // namespace inceres::internal
