#pragma once

#include <cstdint>
#include <vector>

#include "base/executor.h"
#include "inceres/problem/factor_graph.h"
#include "incremental/active_bounds.h"
#include "incremental/active_variables.h"
#include "incremental/dogleg_path.h"
#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"
#include "incremental/landmark_searches.h"
#include "linearize/incremental_family.h"
#include "linearize/variable_store.h"

namespace inceres::internal {

/// A step of an incremental system, from the first frame that is told to move until it is accepted
/// or taken back:
///
///     SetFrame, Visit -> Evaluate -> UpdateRhs, MoveValues, End; or Reject
///
/// What is not set does not move, and no step leaves the bounds: it is cut off there, and what
/// follows from it takes it as it then is. The cost of each verb goes with the factors that the
/// step touches.
class TrialStep {
 public:
  TrialStep(const FactorGraph& graph, const Executor& executor, double max_stretch,
            VariableStore* variables, std::vector<IncrementalFamily>* families,
            IncrementalSchur* schur, ActiveBounds* bounds)
      : graph_(graph),
        executor_(executor),
        variables_(*variables),
        families_(*families),
        schur_(*schur),
        bounds_(*bounds),
        active_(*schur),
        searches_(max_stretch) {}
  TrialStep(const TrialStep&) = delete;
  TrialStep& operator=(const TrialStep&) = delete;

  /// Makes room for the variables, and for a family's factors, that have come.
  void GrowVariables();
  void GrowFactors(FamilyId family);

  void SetFrame(std::int32_t frame, const double* step);
  /// As it stands.
  const double* Frame(std::int32_t frame) const {
    return active_.step(schur_.frames()[frame].quad);
  }
  /// Back-substitutes a landmark from the frame steps set so far.
  void Visit(std::int32_t landmark);
  /// The same for each of the list.
  void Visit(const std::vector<std::int32_t>& landmarks);
  bool Visited(std::int32_t landmark) const { return active_.landmarks().Has(landmark); }

  /// Whether bounds have shortened this step, or the last one if it has ended.
  bool is_cut_off() const { return is_cut_off_; }

  /// Change of the cost, and the decrease the linearizations predict, over the factors the step
  /// touches.
  Status Evaluate(double* change, double* predicted_decrease);
  /// ‖Dδ‖ of the step as it stands, D² = diag H.
  double ScaledNorm() const { return active_.ScaledNorm(); }
  /// ‖δ‖ of the step as it stands.
  double Norm() const { return active_.Norm(); }
  /// What damping takes part with, of the step as it stands.
  DampedSquares FindDampedSquares(double mu, double lambda) const {
    return active_.FindDampedSquares(mu, lambda);
  }
  /// ‖δ_i‖_∞ over the factor's variables.
  double Largest(FactorRef ref) const;
  /// Replaces the step, taken as the Gauss–Newton step of its active set, by the point at this
  /// scaled norm on the dog-leg path from the Cauchy point of the same active set to it. To be
  /// evaluated anew. The first call after a step prepares the path with one pass over the touched
  /// factors.
  void Shorten(double scaled_norm);

  /// A step of these landmarks alone, each of which is kept or not for itself. True if any was: it
  /// then waits to be accepted, or else nothing moves. A landmark whose cost falls faster than its
  /// model says, as on the far side of a robust loss, goes further the next time. *num_evaluated
  /// gets the factors looked at.
  bool TryLandmarks(const std::vector<std::int32_t>& landmarks, int* num_evaluated);
  const LandmarkSearches& landmark_searches() const { return searches_; }
  /// What the steps of a landmark alone have shown does not hold from other values.
  void ForgetLandmark(std::int32_t landmark) { searches_.Forget(landmark); }

  /// Per family, ascending: the factors the step touches; between Evaluate and End.
  const std::vector<std::int32_t>& Touched(FamilyId family) const { return touched_lists_[family]; }

  /// Accepted: gradient shares and b follow, once residuals have. Returns how many landmarks'
  /// right-hand sides did.
  int UpdateRhs();
  /// Calls visit(landmark) for these landmarks; before End.
  template <typename Visit>
  void ForEachUpdated(Visit&& visit) const {
    active_.landmarks().ForEach(visit);
    stale_landmarks_.ForEach(visit);
  }
  void MoveValues();
  /// Nothing moves.
  void Reject();
  /// The next step may begin.
  void End();

  std::int64_t Bytes() const {
    return static_cast<std::int64_t>(active_.step().capacity() * sizeof(double));
  }

 private:
  void Begin() { is_cut_off_ = is_cut_off_ && !active_.empty(); }
  template <typename Work>
  void FetchAndDo(const std::vector<std::int32_t>& landmarks, const Work& work) const;
  template <typename Variable>
  void CutOff(const Variable& moved);
  template <typename Variable>
  void Move(const Variable& moved);
  void Touch(const std::vector<FactorRef>& factors);
  void TouchAndReach(const std::vector<FactorRef>& factors);
  void NameTouched();
  void TouchAll();
  void ReachFromFrame(std::int32_t frame);
  void DropChanges();
  std::int32_t EvaluateLandmarks(int* num_evaluated);
  bool EvaluateUnrefused(int* num_evaluated);
  void LeaveOut(std::int32_t landmark);

  const FactorGraph& graph_;
  const Executor& executor_;
  VariableStore& variables_;
  std::vector<IncrementalFamily>& families_;
  IncrementalSchur& schur_;
  ActiveBounds& bounds_;

  ActiveVariables active_;
  bool is_cut_off_ = false;
  std::vector<IndexSet> touched_;  // per family: with a variable that moves
  std::vector<std::vector<std::int32_t>> touched_lists_;
  bool touched_named_ = false;         // the two above and the two below are those of the step
  IndexSet stale_landmarks_;           // not visited, but seen from a frame that moves
  IndexSet reached_;                   // frames of touched factors and of their landmarks
  std::vector<std::int32_t> updated_;  // scratch of UpdateRhs
  DoglegPath path_;
  LandmarkSearches searches_;
};

}  // namespace inceres::internal
