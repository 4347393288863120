#pragma once

#include <cstdint>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "incremental/active_bounds.h"
#include "incremental/dirty_subgraph.h"
#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"
#include "incremental/running_cost.h"
#include "incremental/trial_step.h"
#include "linearize/incremental_family.h"
#include "linearize/variable_store.h"

namespace inceres::internal {

/// Which variables and factors of a graph take part in a living system, and where: a frame has a
/// row of S, a landmark a number among the landmarks, a factor the frames and the landmark it is
/// connected to. A variable that is constant when it comes stays outside until it is set free, and
/// then its factors are connected anew; one that becomes constant keeps its place and is held. A
/// factor that comes while it is held, and could not have it free, is not connected to it.
///
/// Calls follow the graph: removals come before it forgets, all else after it knows. What comes or
/// is connected anew is marked for relinearization. The cost goes with the variables and factors
/// named and with the factors of those variables.
class Membership {
 public:
  Membership(FactorGraph& graph, VariableStore* variables, std::vector<IncrementalFamily>* families,
             ActiveBounds* bounds, IncrementalSchur* schur, TrialStep* step, DirtySubgraph* dirty,
             RunningCost* cost)
      : graph_(graph),
        variables_(*variables),
        families_(*families),
        bounds_(*bounds),
        schur_(*schur),
        step_(*step),
        dirty_(*dirty),
        cost_(*cost) {}
  Membership(const Membership&) = delete;
  Membership& operator=(const Membership&) = delete;

  void AddVariable(VariableId id);
  /// No factor may touch it any more.
  void RemoveVariable(VariableId id);
  void AddFactor(FactorRef ref);
  void RemoveFactor(FactorRef ref);
  /// Constancy as the graph has it now. The factors of a variable that was part of the system are
  /// not evaluated again.
  void FollowConstants(const std::vector<VariableId>& ids);
  /// Bounds as the graph has them now; values stay.
  void FollowBounds(VariableId id);
  /// Its factors are linearized at the graph's pin from now on, or no longer.
  void FollowPin(VariableId id);

  /// The variable's row of S, or its number among the landmarks, or -1.
  int FrameOf(VariableId id) const { return frame_of_[id]; }
  int LandmarkOf(VariableId id) const { return landmark_of_[id]; }
  int num_factors() const { return num_factors_; }
  /// Rows of S whose variables have bounds.
  const IndexSet& bounded_frames() const { return bounded_frames_; }

  /// The frames that have come since the last call and are still there, held ones left out.
  void TakeNewFrames(IndexSet* frames);
  /// Those that have come so far are nothing new.
  void ForgetNewFrames() { entered_.clear(); }

 private:
  void Enter(VariableId id);
  void Attach(FactorRef ref);
  void Detach(FactorRef ref);
  void TakeOut(std::int32_t landmark);
  void AdmitFamilies();
  void Hold(VariableId id, bool constant);
  void Reattach();

  FactorGraph& graph_;
  VariableStore& variables_;
  std::vector<IncrementalFamily>& families_;
  ActiveBounds& bounds_;
  IncrementalSchur& schur_;
  TrialStep& step_;
  DirtySubgraph& dirty_;
  RunningCost& cost_;

  std::vector<int> frame_of_;     // per variable, or -1
  std::vector<int> landmark_of_;  // per variable, or -1
  int num_factors_ = 0;
  IndexSet bounded_frames_;
  std::vector<VariableId> entered_;  // frames, since TakeNewFrames
  std::vector<std::int32_t> slots_;
  std::vector<VariableId> entering_;
  std::vector<FactorRef> reattached_;
};

}  // namespace inceres::internal
