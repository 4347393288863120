#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_options.h"
#include "inceres/solver/live_covariance.h"
#include "inceres/solver/marginalization.h"
#include "inceres/solver/solver.h"
#include "inceres/solver/summary.h"
#include "inceres/solver/update_summary.h"

namespace inceres {

/// Looks on while an IncrementalSolver works, and may stop it. What SolveObserver is to the batch
/// solver.
class INCERES_EXPORT UpdateObserver {
 public:
  virtual ~UpdateObserver() = default;

  /// At the end of iteration 0, which is the start, and of every later one, on the thread that
  /// called Update; not of the one that finds out that nothing is left to do.
  /// IncrementalSolver::Values() then gives the best state so far; nothing else of the solver may
  /// be called but RequestStop(). kTerminateSuccessfully ends the Update with that state, kAbort
  /// with the values held before it.
  virtual ObserverAction EndOfIteration(const UpdateIteration& iteration) = 0;
};

/// All values that an IncrementalSolver held at the end of one Update, and the cost there: what
/// other threads (a display, a planner) read while the solver goes on. A copy, which is the
/// reader's own: it stays as it is, whatever the solver does.
///
/// IncrementalSolver::ReadSnapshot fills one; reading into the same one again and again uses its
/// memory again.
class INCERES_EXPORT ValueSnapshot {
 public:
  /// How many Updates with publish_snapshots there had been, this one included; 0: never filled.
  std::int64_t number() const { return number_; }
  /// ½ Σ ρ at these values.
  double cost() const { return cost_; }
  /// How that Update ended.
  Termination termination() const { return termination_; }
  /// Ids the graph had given out: what is 0 … size() − 1.
  int num_variables() const { return static_cast<int>(offsets_.size()); }
  /// The ambient values of a variable, constants too; null if there was none of this id.
  const double* Values(VariableId id) const {
    const bool known = id >= 0 && id < num_variables() && offsets_[Index(id)] >= 0;
    return known ? values_.data() + offsets_[Index(id)] : nullptr;
  }

 private:
  friend class IncrementalSolver;
  static std::size_t Index(VariableId id) { return static_cast<std::size_t>(id); }

  std::int64_t number_ = 0;
  double cost_ = 0.0;
  Termination termination_ = Termination::kFailure;
  std::vector<std::ptrdiff_t> offsets_;  // by id: into values_, −1 of a removed variable
  std::vector<double> values_;
};

/// The block sparsity of the reduced system S of an IncrementalSolver, and where its last Update
/// changed it. For pictures and for understanding what an Update costs; the numbers themselves stay
/// inside.
struct ReducedStructure {
  /// A block below the diagonal: row > column. Stored, so it may have become zero. Blocks go with
  /// one of their frames; of two frames of which one sees no landmarks also with the last factor of
  /// both that is there, and not turned off (ScaledLoss with scale 0).
  struct Block {
    int row;     ///< block row, below the diagonal
    int column;  ///< block column
  };
  /// The frame of each block row, in order of arrival: the order in which the resumed Cholesky
  /// eliminates them too until loops have aged it. −1: a frame was removed and its row is not in
  /// use again yet. A frame that is held constant keeps its row.
  std::vector<VariableId> frames;
  /// Sorted by row, then by column.
  std::vector<Block> blocks;
  /// Per block row: the last Update, or an edit since the one before, added to its blocks or took
  /// from them. A block changed only if both of its rows did.
  std::vector<bool> changed;
  /// The frames in the order in which the factor of the last Update eliminates them: of two that it
  /// couples that of the lower group first (FactorGraph::SetEliminationGroup). Empty without a
  /// factor: of kPcg, of a user's solver, and until the incremental solver itself has factored.
  std::vector<VariableId> elimination_order;
};

/// The solver that remembers: after the first Update, work goes with what changed. Apply edits,
/// then Update.
///
/// An Update that is mostly new goes to the batch solver first. Otherwise: Levenberg–Marquardt on
/// the reduced system with diag(C) as the metric; a landmark takes up the current damping only when
/// it is re-eliminated, so that a change of damping touches no landmark. Frames whose share of the
/// step is worth little stay put, landmarks that could gain much by themselves step by themselves,
/// and an Update ends when what is left undone is worth less than the function tolerance. A
/// rejected step refreshes old Jacobians before it retreats, first along the dog-leg path, then by
/// more damping; convergence is declared on fresh Jacobians only: old ones defer it, they do not
/// replace it. docs/incremental.md explains, and how to choose the thresholds.
///
/// Values keep within bounds that an edit sets (GraphEdit::SetBounds): a coordinate at a bound out
/// of which its gradient pushes it is held there, and steps are cut off at bounds (Bertsekas,
/// "Projected Newton methods for optimization problems with simple constraints", 1982).
///
/// Threads: one writer, and readers by ReadSnapshot; Update works on options.num_threads, and calls
/// no factor concurrently when that is 1. Source: algorithms 2 to 4 of the thesis "A General
/// Incremental Bundle Adjustment Framework for Visual-Inertial SLAM" (Zhejiang University), with
/// the corrections that docs/algorithms.md states.
class INCERES_EXPORT IncrementalSolver {
 public:
  /// An empty problem. What is wrong with the options is told by the first Apply or Update.
  explicit IncrementalSolver(const IncrementalOptions& options);
  ~IncrementalSolver();
  IncrementalSolver(const IncrementalSolver&) = delete;
  IncrementalSolver& operator=(const IncrementalSolver&) = delete;

  /// The problem as edited so far. Its state may lag behind: the current values are Values().
  const FactorGraph& graph() const;

  /// Adds a family, for good: families cost nothing while they are empty.
  FamilyId AddFamily(std::shared_ptr<const FactorFamily> family);

  /// The same, of a family whose type is known: the handle is what GraphEdit::AddFactor takes.
  template <typename Family>
  FamilyHandle<Family> AddFamily(std::shared_ptr<Family> family) {
    const FamilyId id = AddFamily(std::shared_ptr<const FactorFamily>(family));
    return {id, std::move(family)};
  }

  /// As FactorGraph::SetVariableNames: what messages call the variables.
  void SetVariableNames(std::function<std::string(VariableId)> name_of);

  /// Carries out an edit, begun with GraphEdit(solver.graph()), all or nothing: an error names the
  /// id at fault, and the solver is as it was. No factor is evaluated before the next Update;
  /// families take measurements in. Cost: goes with the edit.
  Status Apply(const GraphEdit& edit);

  /// Takes variables out and keeps what their factors say about others as a prior factor:
  /// Marginalize (marginalization.h) at the current values, all or nothing, with the cached
  /// Jacobians wherever an Update would still call them good enough to converge on; so best after
  /// one that converged. The next Update starts from where everything is.
  MarginalizationSummary Marginalize(const MarginalizationRequest& request,
                                     const MarginalizationOptions& options);

  /// Other options from the next Update on, but for num_threads, reduced_solver and its factory,
  /// which stay what they were. After a tolerance that is stricter, or another value of what
  /// convergence rests on, the next Update looks again, though nothing else has changed.
  void SetOptions(const IncrementalOptions& options);

  /// Minimizes from the current state. A failure names its factor or variable and keeps the last
  /// accepted step; what was changed since the last Update takes part again in the next one, from
  /// there.
  UpdateSummary Update();
  /// The same into the memory of an earlier summary: in a steady state nothing is allocated.
  /// `observer`, which may be null, sees every iteration and may end the Update; with one an Update
  /// costs a pass over all variables more, and one an iteration. After its kAbort the values are
  /// those of before the Update, and the next one works as after a failure. What factors, losses
  /// or manifolds throw passes through: the values are then those of before, or without an observer
  /// those of the last step, and cost() is that of the last iteration that was completed.
  void Update(UpdateSummary* summary, UpdateObserver* observer = nullptr);

  /// From any thread: the Update that runs now, or else the next one, ends at its next iteration
  /// with the best state so far.
  void RequestStop();

  /// Current values of a variable: what the last Update found, or what it was added with; to an
  /// observer the best so far. (Not those of the graph's own state, which follow from time to
  /// time.)
  const double* Values(VariableId id) const;
  /// ½ Σ ρ at the current state, as of the last Update; if that failed, of the factors that were
  /// evaluated before it.
  double cost() const;

  /// Copies what the last Update with publish_snapshots ended with. From any thread, at any time,
  /// but not while the solver is made or destroyed. False, `snapshot` untouched, if there was no
  /// such Update yet. All values of a snapshot, and its cost, are of one and the same state; an
  /// edit shows in it after the next Update.
  ///
  /// The Update never waits for a reader, and allocates nothing for its copy once problems have
  /// stopped growing for three Updates; readers wait for each other for as long as a copy takes.
  bool ReadSnapshot(ValueSnapshot* snapshot) const;

  /// Which blocks S has, and which of its rows the last Update changed. Not during an Update. After
  /// one that the batch solver ended by itself S waits to be formed by the next one. Cost:
  /// proportional to the blocks.
  ReducedStructure Structure() const;

  /// The joint covariance of these variables after an Update, in their tangent spaces: blocks of
  /// H⁻¹ as GraphCovariance defines them, of landmarks too, from what the Update has left, S, its
  /// factor and the landmarks' Y. Its Jacobians are those of the Update, some of them old, unless
  /// options.accuracy is kExact; `covariance->staleness` tells how far that is off. A constant has
  /// zeros. Of factors that are whitened; otherwise it is a multiple.
  ///
  /// kInvalidArgument: an id is unknown, repeated, or of a variable that no factor touches; or the
  /// graph was edited since the last Update, or that failed. kSingular names a variable that its
  /// factors do not determine, and says so where the gauge is free: then there is no covariance.
  /// kUnavailable: of kPcg and a user's solver, which have no factor, only kUndamped is to be had;
  /// conjugate gradients take too long; or values are held at their bounds. `covariance` is then
  /// empty, but for the staleness.
  ///
  /// Cost: of the factor only the path from the variables (of a landmark: the frames that see it)
  /// to the root of the Bayes tree, or what comes after them in the envelope. kUndamped, before
  /// that: the cliques that have changed since it was last asked for, the first time all, but for a
  /// few rows; afterwards it holds the memory of a second factor. Now and then a few solves, to
  /// find a free gauge. kExact: a linearization of the whole problem, and for each column some
  /// passes over it and solves. After an Update that the batch solver ended by itself S is formed
  /// first, once, as the next Update would. Threads: the calling one, as for Update, and
  /// options.num_threads for factors and large fronts; the same bits for any number. Source: Kaess
  /// & Dellaert, "Covariance recovery from a square root information matrix for data association",
  /// RAS 57(12), 2009; docs/incremental.md.
  Status Covariance(const std::vector<VariableId>& ids, const LiveCovarianceOptions& options,
                    LiveCovariance* covariance) const;
  /// Of one variable.
  Status MarginalCovariance(VariableId id, const LiveCovarianceOptions& options,
                            LiveCovariance* covariance) const {
    return Covariance({id}, options, covariance);
  }
  /// Of a pair: first a, then b.
  Status JointCovariance(VariableId a, VariableId b, const LiveCovarianceOptions& options,
                         LiveCovariance* covariance) const {
    return Covariance({a, b}, options, covariance);
  }

 private:
  class INCERES_HIDDEN Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres
