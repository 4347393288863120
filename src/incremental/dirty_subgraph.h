#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/executor.h"
#include "inceres/problem/factor_graph.h"
#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"
#include "incremental/running_cost.h"
#include "linearize/incremental_family.h"
#include "linearize/variable_store.h"

namespace inceres::internal {

/// What a call of IncrementalSystem::Relinearize did.
struct RelinearizeWork {
  int num_factors = 0;         // linearized
  int num_landmarks = 0;       // eliminated
  int num_recentered = 0;      // expansion points moved since the last call
  int num_drifted_frames = 0;  // summed anew against cancellation
  bool rebuilt = false;        // S and b summed anew
};

/// The part of a living problem that is to be linearized or eliminated anew, and how that is done
/// (the thesis's algorithm 3): old contributions go out of S and b, and new ones in. Factors are
/// marked as they are added, change, or are found to be linearized too far away; landmarks with
/// their factors, or for another damping. The cost goes with what is marked.
class DirtySubgraph {
 public:
  /// `replace_cost`: Tuning::Rebuild::replace_cost.
  DirtySubgraph(const FactorGraph& graph, const Executor& executor, double replace_cost,
                VariableStore* variables, std::vector<IncrementalFamily>* families,
                IncrementalSchur* schur, RunningCost* cost)
      : graph_(graph),
        executor_(executor),
        replace_cost_(replace_cost),
        variables_(*variables),
        families_(*families),
        schur_(*schur),
        cost_(*cost) {}
  DirtySubgraph(const DirtySubgraph&) = delete;
  DirtySubgraph& operator=(const DirtySubgraph&) = delete;

  /// Makes room for a family's factors, and for the landmarks, that have come.
  void GrowFactors(FamilyId family);
  void GrowLandmarks() { landmarks_.Grow(schur_.landmarks().size()); }

  /// Marks a factor for relinearization.
  void Mark(FactorRef ref) { factors_[ref.family].Add(ref.factor); }
  /// The same for a factor that is another function now, or where neither a step nor the batch
  /// solver has led it.
  void MarkChanged(FactorRef ref) {
    families_[ref.family].Unsettle(ref.factor);
    StopWaiting(ref);
    Mark(ref);
  }
  /// Marks a factor that has another loss and is the same function otherwise: what is cached of it
  /// takes the new weight in the next Reweigh, if it can.
  void MarkReweighed(FactorRef ref) {
    if (families_[ref.family].CanReweigh(ref.factor)) {
      reweighed_[ref.family].Add(ref.factor);
    } else {
      MarkChanged(ref);
    }
  }
  /// Marks a landmark for elimination anew.
  void MarkLandmark(std::int32_t landmark) { landmarks_.Add(landmark); }
  /// The same of the landmarks that their damping hides more of than `gain`, against what this λ
  /// would: all of them together. True if there are any. Cost: that of landmarks with a pivot that
  /// is mostly damping.
  bool MarkHidden(double lambda, double gain);
  /// All landmarks that were eliminated with more damping than this; true if there are any. Cost: a
  /// look at each.
  bool MarkDampedMore(double lambda);

  /// They are gone, or part of nothing.
  void DropFactor(FactorRef ref) {
    factors_[ref.family].Remove(ref.factor);
    reweighed_[ref.family].Remove(ref.factor);
  }
  /// The factors that are dirty now are so only because others have moved their variables: they
  /// wait, until they are linearized or removed.
  void LetWait() { waiting_ = factors_; }
  void StopWaiting(FactorRef ref) { waiting_[ref.family].Remove(ref.factor); }
  int NumWaiting() const { return Count(waiting_); }
  void DropLandmark(std::int32_t landmark) { landmarks_.Remove(landmark); }

  bool Has(FactorRef ref) const {
    return factors_[ref.family].Has(ref.factor) || reweighed_[ref.family].Has(ref.factor);
  }
  int NumFactors() const { return Count(factors_); }
  /// Nothing is marked.
  bool IsEmpty() const { return NumFactors() + NumReweighed() + landmarks_.count() == 0; }
  /// Marked for another weight, and not dirty.
  int NumReweighed() const { return Count(reweighed_); }

  /// IncrementalSystem::Reweigh.
  const std::vector<FactorRef>& Reweigh();
  /// Lets factors at new values move their expansion points: they are other functions then.
  void Recenter(const IncrementalFamily& family, const std::vector<std::int32_t>& factors);
  /// What a Linearize begins with: the expansion points of all that is marked; counts it.
  void Begin(RelinearizeWork* work);
  /// Linearizes the factors that are marked, and marks their landmarks. By difference their new
  /// contributions to S take the places of the old ones; else S is to be summed anew from caches.
  /// On failure names the factor or variable.
  Status Linearize(bool by_difference);
  /// Eliminates the landmarks that are marked, with λD; how many.
  int Eliminate(double lambda);
  /// Their contributions are part of sums to be made anew no longer.
  void TakeOutLandmarks() {
    landmarks_.ForEach([this](std::int32_t landmark) { schur_.TakeOut(landmark); });
  }
  /// Whether summing S and b of so many factors anew is cheaper than following by difference what
  /// is marked.
  bool RebuildIsCheaper(int num_factors) const;

 private:
  static int Count(const std::vector<IndexSet>& sets);
  void ReweighFamily(IncrementalFamily* family);
  Status LinearizeFamily(IncrementalFamily* family, bool by_difference);
  Status Keep(IncrementalFamily* family, bool by_difference);
  Status EvaluateFamily(IncrementalFamily* family);
  Status InfiniteCost(const IncrementalFamily& family) const;

  const FactorGraph& graph_;
  const Executor& executor_;
  const double replace_cost_;
  VariableStore& variables_;
  std::vector<IncrementalFamily>& families_;
  IncrementalSchur& schur_;
  RunningCost& cost_;

  std::vector<IndexSet> factors_;    // per family: to be relinearized
  std::vector<IndexSet> waiting_;    // per family, of those: nothing but their place has changed
  std::vector<IndexSet> reweighed_;  // per family: to take another weight
  IndexSet landmarks_;               // to be eliminated anew
  int num_recentered_ = 0;           // since the last Begin
  std::vector<FactorRef> reweighed_list_;
  std::vector<std::int32_t> list_;
  // of the listed factors: where S keeps their old contributions; -1: none
  std::vector<std::ptrdiff_t> kept_;
};

}  // namespace inceres::internal
