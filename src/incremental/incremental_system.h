#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/executor.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "incremental/active_bounds.h"
#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"
#include "incremental/trial_step.h"
#include "incremental/tuning.h"
#include "linearize/incremental_family.h"
#include "linearize/variable_store.h"

namespace inceres::internal {

/// When S and b are summed anew instead of following by difference. The result is the same up to
/// rounding.
enum class RebuildRule { kWhenCheaper, kAlways, kNever };

/// What a call of Relinearize did.
struct RelinearizeWork {
  int num_factors = 0;         // linearized
  int num_landmarks = 0;       // eliminated
  int num_recentered = 0;      // expansion points moved since the last call
  int num_drifted_frames = 0;  // summed anew against cancellation
  bool rebuilt = false;        // S and b summed anew
};

/// A living problem with everything that was ever computed for it: values, cached linearizations, S
/// and b. What an incremental strategy drives:
///
///     edits -> Relinearize -> (solve S' δ_c = b elsewhere)
///           -> step().SetFrame, Visit, Evaluate -> Accept or step().Reject
///
/// The cost of each verb goes with the factors it touches, not with the size of the problem. Edits
/// follow those of the graph; removals come before the graph forgets, additions after it knows.
/// Threads: evaluation runs on `num_threads`, with the same bits for any number; all else on the
/// calling one. Source: docs/algorithms.md, "Incremental Schur complement" (the thesis's algorithms
/// 2 to 4).
class IncrementalSystem {
 public:
  /// The graph belongs to the caller; it is asked to keep track of its variables' factors, and
  /// nothing else about it changes.
  IncrementalSystem(FactorGraph& graph, int num_threads, const Tuning& tuning = Tuning())
      : graph_(graph),
        executor_(num_threads),
        bounds_(graph_, &variables_),
        schur_(&families_, &bounds_),
        step_(graph_, executor_, tuning.landmarks.max_stretch, &variables_, &families_, &schur_,
              &bounds_),
        replace_cost_(tuning.rebuild.replace_cost) {}
  IncrementalSystem(const IncrementalSystem&) = delete;
  IncrementalSystem& operator=(const IncrementalSystem&) = delete;

  /// Carries out an edit of the graph and follows it, all or nothing: an error names the id at
  /// fault. What changed is evaluated in the next Relinearize.
  Status Apply(const GraphEdit& edit);

  /// Whether all that has come since WatchGrowth are variables and factors, and nothing else about
  /// the problem is another.
  bool OnlyGrew() const { return only_grew_; }
  void WatchGrowth() { only_grew_ = true; }

  // What Apply is made of, and what follows a graph that is built without edits.

  /// A variable that is constant when it comes stays outside the system until it is set free.
  void AddVariable(VariableId id);
  /// No factor may touch it any more.
  void RemoveVariable(VariableId id);
  void AddFactor(FactorRef ref);
  void RemoveFactor(FactorRef ref);
  /// Constancy as the graph has it now. The factors of a variable that was part of the system are
  /// not evaluated again.
  void UpdateConstants(const std::vector<VariableId>& ids);
  void SetValues(VariableId id, const double* values);
  /// Bounds as the graph has them now.
  void FollowBounds(VariableId id);
  /// All values as the graph has them now. Every factor must be dirty.
  void TakeValues();

  /// Marks a factor for relinearization.
  void MarkDirty(FactorRef ref) { dirty_[ref.family].Add(ref.factor); }
  /// The same for a factor that is another function now, or where a step has not led it.
  void MarkChanged(FactorRef ref) {
    families_[ref.family].Unsettle(ref.factor);
    MarkDirty(ref);
  }
  /// Marks a factor that has another loss and is the same function otherwise: what is cached of it
  /// takes the new weight in the next Relinearize, if it can.
  void MarkReweighed(FactorRef ref) {
    if (families_[ref.family].CanReweigh(ref.factor)) {
      reweighed_[ref.family].Add(ref.factor);
    } else {
      MarkChanged(ref);
    }
  }
  /// Marks a landmark for elimination anew, to take up another damping.
  void Redamp(std::int32_t landmark) { dirty_landmarks_.Add(landmark); }
  /// The same for the landmarks that are damped by more than the limit, or by
  /// LandmarkBlocks::kMildDamping where that is more.
  void RedampAbove(double limit) {
    schur_.blocks().ForEachDampedAbove(limit, [this](std::int32_t landmark) { Redamp(landmark); });
  }

  /// Marks the landmarks that their damping hides more of than `gain`, against what this λ would:
  /// all of them together. True if there are any. Cost: that of landmarks with a pivot that is
  /// mostly damping.
  bool RedampHidden(double lambda, double gain);

  /// Gives the factors that were marked for it their new weights, and S and b what that makes of
  /// their contributions; no factor is evaluated. Those are listed that are not to be linearized
  /// anyway: their old linearizations err by more where they weigh more. What Relinearize begins
  /// with, for whoever wants to look at them before. Cost: that of a factor's share of S for each.
  const std::vector<FactorRef>& Reweigh();

  /// Algorithm 3: takes the old contributions of the dirty subgraph out of S and b, linearizes its
  /// factors at the current values and puts the new ones in; its landmarks are damped by lambda ·
  /// diag(P). On failure names the factor or variable; S and b are then incomplete.
  Status Relinearize(double lambda, RebuildRule rule, RelinearizeWork* work);

  /// The first half of it, by difference: what is dirty is linearized, and its landmarks wait to be
  /// eliminated anew.
  Status LinearizeDirty(RelinearizeWork* work);

  /// Whether summing S and b anew is cheaper than following what is dirty by difference.
  bool RebuildIsCheaper() const;

  /// The frames that have come since the last call and are still there, held ones left out.
  void TakeNewFrames(IndexSet* frames);
  /// Those that have come so far are nothing new.
  void ForgetNewFrames() { entered_.clear(); }

  /// The one under construction.
  TrialStep& step() { return step_; }
  const TrialStep& step() const { return step_; }
  /// A step of these landmarks alone (TrialStep::TryLandmarks), accepted as by AcceptValues if any
  /// of them gained.
  bool StepLandmarks(const std::vector<std::int32_t>& landmarks, int* num_evaluated) {
    const bool any = step_.TryLandmarks(landmarks, num_evaluated);
    if (any) {
      AcceptValues();
    }
    return any;
  }

  /// Ends the step: the values move, and residuals, gradient shares and b follow; Jacobians stay.
  void Accept() {
    AcceptValues();
    step_.End();
  }
  /// The first half of it, for whoever wants to look at the touched factors in between: tells how
  /// many landmarks' right-hand sides followed.
  int AcceptValues();

  int NumDirtyFactors() const;
  /// The factors that are dirty now are so only because others have moved their variables: they
  /// wait, until they are linearized or removed.
  void LetDirtyWait() { waiting_ = dirty_; }
  int NumWaitingFactors() const;
  /// Marked for another weight, and not dirty.
  int NumReweighedFactors() const;
  /// Whether what is cached of it is not what it is now.
  bool IsDirty(FactorRef ref) const {
    return dirty_[ref.family].Has(ref.factor) || reweighed_[ref.family].Has(ref.factor);
  }
  double cost() const { return cost_; }
  /// How much of the cost rounding may be: ½ Σ_v ‖x_v‖_∞² tr(C_vv) (n ε)², for a residual that
  /// comes of n operations on numbers as large as J_v x_v is exact to n ε ‖x_v‖ ‖J_v‖. Cost: a pass
  /// over the frames, or over the landmarks where no frame can move.
  double RoundingOfCost() const;
  int num_factors() const { return num_factors_; }
  const ActiveBounds& bounds() const { return bounds_; }
  const FactorGraph& graph() const { return graph_; }
  const VariableStore& variables() const { return variables_; }
  /// The variable's row of S, or its number among the landmarks, or -1.
  int FrameOf(VariableId id) const { return frame_of_[id]; }
  int LandmarkOf(VariableId id) const { return landmark_of_[id]; }
  const std::vector<IncrementalFamily>& families() const { return families_; }
  IncrementalSchur& schur() { return schur_; }
  const IncrementalSchur& schur() const { return schur_; }
  const Executor& executor() const { return executor_; }
  std::int64_t Bytes() const;

 private:
  bool IsWaiting(FactorRef ref) const {
    return ref.family < static_cast<FamilyId>(waiting_.size()) &&
           waiting_[ref.family].Reaches(ref.factor) && waiting_[ref.family].Has(ref.factor);
  }
  void Enter(VariableId id);
  void Attach(FactorRef ref);
  void Detach(FactorRef ref);
  // Of S, for its factors are about to be others.
  void TakeOut(std::int32_t landmark) {
    dirty_landmarks_.Add(landmark);
    schur_.TakeOut(landmark);
  }
  void AdmitFamilies();
  void Recenter(const IncrementalFamily& family, const std::vector<std::int32_t>& factors);
  Status LinearizeFamilies(bool by_difference);
  Status LinearizeFamily(IncrementalFamily* family, bool by_difference);
  Status InfiniteCost(const IncrementalFamily& family) const;
  void ReweighFamily(IncrementalFamily* family);
  void RecenterDirty(RelinearizeWork* work);
  void AddToCost(double change) {
    cost_ += change;
    cost_peak_ = std::max(cost_peak_, cost_);
    ++cost_changes_;
  }
  void ResumCost();
  void Hold(VariableId id, bool constant);
  void HoldAtBounds();
  void Confine(VariableId id);
  void MarkMoved(VariableId id);
  void FollowPin(VariableId id);
  void Reattach();

  FactorGraph& graph_;
  Executor executor_;
  VariableStore variables_;
  std::vector<IncrementalFamily> families_;
  ActiveBounds bounds_;
  IncrementalSchur schur_;
  TrialStep step_;
  const double replace_cost_;
  std::vector<int> frame_of_;     // per variable, or -1
  std::vector<int> landmark_of_;  // per variable, or -1
  int num_factors_ = 0;
  bool only_grew_ = false;
  int num_recentered_ = 0;  // since the last Relinearize
  double cost_ = 0.0;
  double cost_peak_ = 0.0;         // the largest it has been since it was summed
  std::int64_t cost_changes_ = 0;  // since then

  std::vector<IndexSet> dirty_;      // per family: to be relinearized
  std::vector<IndexSet> waiting_;    // per family, of those: nothing but their place has changed
  std::vector<IndexSet> reweighed_;  // per family: to take another weight
  std::vector<FactorRef> reweighed_list_;
  IndexSet dirty_landmarks_;  // to be eliminated anew
  IndexSet bounded_frames_;   // rows of S
  std::vector<std::int32_t> list_;
  // of the listed factors: where S keeps their old contributions; -1: none
  std::vector<std::ptrdiff_t> kept_;
  std::vector<std::int32_t> slots_;
  std::vector<FactorId> removed_;
  std::vector<VariableId> toggled_;
  std::vector<VariableId> entering_;
  std::vector<VariableId> entered_;  // frames, since TakeNewFrames
  std::vector<FactorRef> reattached_;
};

}  // namespace inceres::internal
