#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/executor.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_options.h"
#include "incremental/active_bounds.h"
#include "incremental/cost_rounding.h"
#include "incremental/dirty_subgraph.h"
#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"
#include "incremental/membership.h"
#include "incremental/running_cost.h"
#include "incremental/trial_step.h"
#include "incremental/tuning.h"
#include "linearize/incremental_family.h"
#include "linearize/variable_store.h"

namespace inceres::internal {

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
        dirty_(graph_, executor_, tuning.rebuild.replace_cost, &variables_, &families_, &schur_,
               &cost_),
        members_(graph_, &variables_, &families_, &bounds_, &schur_, &step_, &dirty_, &cost_),
        rounding_(graph_, variables_, families_, &schur_) {}
  IncrementalSystem(const IncrementalSystem&) = delete;
  IncrementalSystem& operator=(const IncrementalSystem&) = delete;

  /// Carries out an edit of the graph and follows it, all or nothing: an error names the id at
  /// fault. What changed is evaluated in the next Relinearize.
  Status Apply(const GraphEdit& edit);

  /// Whether all that has come since WatchGrowth are variables and factors, and nothing else about
  /// the problem is another.
  bool OnlyGrew() const { return only_grew_; }
  void WatchGrowth() { only_grew_ = true; }
  /// Whether edits have rewritten values or measurements, or removed factors, since the last call.
  bool TakeRewritten() { return std::exchange(is_rewritten_, false); }

  // What Apply is made of, and what follows a graph that is built without edits.

  /// As Membership has them.
  void AddVariable(VariableId id) { members_.AddVariable(id); }
  void AddFactor(FactorRef ref) { members_.AddFactor(ref); }
  void SetValues(VariableId id, const double* values);
  /// All values as the graph has them now. Every factor must be dirty.
  void TakeValues();

  /// Marks a factor for relinearization; and a landmark for elimination anew, to take up another
  /// damping.
  void MarkDirty(FactorRef ref) { dirty_.Mark(ref); }
  void Redamp(std::int32_t landmark) { dirty_.MarkLandmark(landmark); }
  /// The same for the landmarks that are damped by more than the limit, or by
  /// LandmarkBlocks::kMildDamping where that is more.
  void RedampAbove(double limit) {
    schur_.blocks().ForEachDampedAbove(limit, [this](std::int32_t landmark) { Redamp(landmark); });
  }
  /// DirtySubgraph::MarkHidden.
  bool RedampHidden(double lambda, double gain) { return dirty_.MarkHidden(lambda, gain); }
  /// DirtySubgraph::MarkDampedMore.
  bool RedampAll(double lambda) { return dirty_.MarkDampedMore(lambda); }

  /// Gives the factors that were marked for it their new weights, and S and b what that makes of
  /// their contributions; no factor is evaluated. Those are listed that are not to be linearized
  /// anyway: their old linearizations err by more where they weigh more. What Relinearize begins
  /// with, for whoever wants to look at them before. Cost: that of a factor's share of S for each.
  const std::vector<FactorRef>& Reweigh() { return dirty_.Reweigh(); }

  /// Algorithm 3: takes the old contributions of the dirty subgraph out of S and b, linearizes its
  /// factors at the current values and puts the new ones in; its landmarks are damped by lambda ·
  /// diag(P). On failure names the factor or variable; S and b are then incomplete.
  Status Relinearize(double lambda, RebuildPolicy policy, RelinearizeWork* work);

  /// The first half of it, by difference: what is dirty is linearized, and its landmarks wait to be
  /// eliminated anew.
  Status LinearizeDirty(RelinearizeWork* work);

  /// Whether summing S and b anew is cheaper than following what is dirty by difference.
  bool RebuildIsCheaper() const { return dirty_.RebuildIsCheaper(num_factors()); }

  /// Membership::TakeNewFrames.
  void TakeNewFrames(IndexSet* frames) { members_.TakeNewFrames(frames); }
  void ForgetNewFrames() { members_.ForgetNewFrames(); }

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

  /// Whether a variable has become constant since it came: its factors still have Jacobians for it.
  bool HasHeldVariables() const {
    const auto is_held = [](const auto& block) { return block.id >= 0 && block.held; };
    return std::any_of(schur_.frames().begin(), schur_.frames().end(), is_held) ||
           std::any_of(schur_.landmarks().begin(), schur_.landmarks().end(), is_held);
  }
  /// Whether nothing is left for Relinearize to follow.
  bool IsUpToDate() const { return dirty_.IsEmpty(); }
  int NumDirtyFactors() const { return dirty_.NumFactors(); }
  /// DirtySubgraph::LetWait.
  void LetDirtyWait() { dirty_.LetWait(); }
  int NumWaitingFactors() const { return dirty_.NumWaiting(); }
  /// Marked for another weight, and not dirty.
  int NumReweighedFactors() const { return dirty_.NumReweighed(); }
  /// Whether what is cached of it is not what it is now.
  bool IsDirty(FactorRef ref) const { return dirty_.Has(ref); }
  double cost() const { return cost_.value(); }
  CostRounding& rounding() { return rounding_; }
  int num_factors() const { return members_.num_factors(); }
  const ActiveBounds& bounds() const { return bounds_; }
  const FactorGraph& graph() const { return graph_; }
  const VariableStore& variables() const { return variables_; }
  /// The variable's row of S, or its number among the landmarks, or -1.
  int FrameOf(VariableId id) const { return members_.FrameOf(id); }
  int LandmarkOf(VariableId id) const { return members_.LandmarkOf(id); }
  const std::vector<IncrementalFamily>& families() const { return families_; }
  IncrementalSchur& schur() { return schur_; }
  const IncrementalSchur& schur() const { return schur_; }
  const Executor& executor() const { return executor_; }
  std::int64_t Bytes() const;

 private:
  void FollowVariablesAndFactors(const GraphEdit& edit);
  void FollowFunctionsAndValues(const GraphEdit& edit);
  void Confine(VariableId id);
  void MarkMoved(VariableId id);
  void HoldAtBounds();

  FactorGraph& graph_;
  Executor executor_;
  VariableStore variables_;
  std::vector<IncrementalFamily> families_;
  ActiveBounds bounds_;
  IncrementalSchur schur_;
  RunningCost cost_;
  TrialStep step_;
  DirtySubgraph dirty_;
  Membership members_;
  CostRounding rounding_;
  bool only_grew_ = false;
  bool is_rewritten_ = false;
  std::vector<FactorId> removed_;
  std::vector<VariableId> toggled_;
};

}  // namespace inceres::internal
