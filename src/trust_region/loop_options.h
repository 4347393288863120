#pragma once

#include <cmath>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/options.h"
#include "inceres/solver/solver.h"
#include "inceres/solver/summary.h"

namespace inceres::internal {

/// Where releases of Ceres differ in the loop: whose trace is to be matched.
enum class CeresRules {
  /// up to 2.1: an infinite or NaN cost counts as converged; parameter_tolerance waits for the
  /// first accepted step, unless there are bounds
  k21,
  /// from 2.2: such a cost is a failed evaluation; parameter_tolerance always waits, and step_norm
  /// is 0 as long as it does; a start that cannot be evaluated has a message of its own
  k22,
};

/// Where a step is from, what it leaves out, and how small it is.
struct StepOrigin {
  double cost = 0.0;       ///< of the current state
  double held_back = 0.0;  ///< what TrustRegionStrategy::HeldBack says of the step
  /// it moves no variable by more than a few units in the last place
  bool within_rounding = false;
  /// degrees of freedom of the variables that StepJudge::HoldsRefusing holds, or would hold
  int num_refusing = 0;
};

/// Whoever may end a solve for the promise of its steps.
class StepJudge {
 public:
  virtual ~StepJudge() = default;

  /// Asked of every step that has a model decrease, before anything is evaluated there: false ends
  /// the solve without it, at the best state, successfully.
  virtual bool IsWorthTrying(const IterationSummary& iteration, const StepOrigin& origin) = 0;

  /// Asked of every step that is accepted, before Jacobians are evaluated there: true ends the
  /// solve with it, successfully and without them. The summary of that iteration has the gradient
  /// norms of the one before. Not asked of a step that made factors move their expansion points.
  virtual bool IsLast(const IterationSummary& iteration) = 0;

  /// Asked before each step of a damped strategy: the radius it is to have at least, for with more
  /// damping the step would tell nothing of weak directions. If it is refused the radius is again
  /// what it was. 0: as it is.
  virtual double LeastRadius() { return 0.0; }

  /// Whether the step under judgment, where it is short or changes the cost by little, may end the
  /// solve by a tolerance.
  virtual bool MayEndByTolerance() { return true; }

  /// Whether a step that was accepted is taken back, and refused, where its end has a cost and no
  /// Jacobians. By default that ends the solve, as in Ceres.
  virtual bool TakesBack() { return false; }

  /// Asked before each step of a damped strategy: whether it is to leave the variables where they
  /// are whose factors have refused to be evaluated since a whole step was last taken.
  virtual bool HoldsRefusing() { return false; }

  /// Asked before each step: the radius to begin anew with, or 0.
  virtual double RestartRadius() { return 0.0; }

  /// Asked at the start, of which Ceres takes the scale of columns for the whole solve: a norm
  /// counts as this at most.
  virtual double MostColumnNorm() { return HUGE_VAL; }
};

/// The linear system of a step: J by blocks, of a factor by a variable, with unscaled columns.
struct StepSystem {
  struct Block {
    FamilyId family;
    int factor;
    VariableId variable;
    int rows;
    int columns;
    const double* values;  ///< rows row_stride apart
    int row_stride;
  };
  int iteration = 0;
  /// By family, of each by factor; without those that are left out as zeros
  /// (Evaluator::set_leaves_out_zero_blocks).
  std::vector<Block> blocks;
  std::vector<std::vector<double>> residuals;  ///< per family, factor after factor
  /// Per VariableId, into the vectors below; -1 of what does not move.
  std::vector<int> first_entry;
  std::vector<double> scale;    ///< of the columns, as the damping sees them
  std::vector<double> damping;  ///< added to the diagonal of JᵀJ
  /// The step; of Dog-Leg the Gauss–Newton step with its sign turned, as Ceres has it.
  std::vector<double> solution;
};

/// Whoever looks at the linear systems of some iterations.
class StepSystemObserver {
 public:
  virtual ~StepSystemObserver() = default;
  virtual bool Wants(int iteration) const = 0;
  /// Asked for after the step has been solved for.
  virtual void See(const StepSystem& system) = 0;
};

/// Ceres's inner iterations: a round of coordinate descent after each step, as long as it is worth
/// it (trust_region/coordinate_descent.h).
struct InnerDescent {
  /// Of variables that share no factor within a group, one group after the other; those in none are
  /// held.
  std::vector<std::vector<VariableId>> groups;
  /// A round that lowers the cost by less than this share of it is the last one.
  double tolerance = 1e-3;
  /// Jacobians are asked for where Ceres asks for them, each time anew: of families that judge what
  /// they compute. Otherwise also at steps that will be taken most likely, and they are kept.
  bool asks_as_ceres = false;

  int num_rounds = 0;    ///< set by the loop
  double seconds = 0.0;  ///< spent on them
};

class Agreement;

/// Where the loop stands after an iteration, beside the values of the variables: enough to go on
/// from there as if nothing had been between.
struct LoopPosition {
  int iteration = 0;
  double initial_cost = 0.0;
  bool any_step_accepted = false;
  int num_consecutive_invalid_steps = 0;
  int num_successful_steps = 0;
  int num_unsuccessful_steps = 0;
  std::vector<double> strategy;  ///< TrustRegionStrategy::Save
  std::vector<double> scale;     ///< of the columns, packed: as iteration 0 has measured it
};

/// Whoever keeps positions. Not of solves with non-monotonic steps, which remember more.
class PositionKeeper {
 public:
  virtual ~PositionKeeper() = default;
  virtual bool Wants(int iteration) const = 0;
  /// `state` as the graph lays it out: where the next step begins.
  virtual void Keep(const LoopPosition& position, const std::vector<double>& state) = 0;
};

/// What the trust-region loop is told beside SolverOptions, by who solves for Ceres or for an
/// Update.
struct LoopOptions {
  CeresRules rules = CeresRules::k21;
  /// A gradient that is no number is below its tolerance, as in Ceres; otherwise it is above.
  bool nan_gradient_is_small = false;
  /// by the caller on this solve; counted into the time limit and cumulative times
  double seconds_spent_before = 0.0;
  /// of the cost, what no variable moves: the function tolerance is relative to the rest
  double fixed_cost = 0.0;
  StepJudge* judge = nullptr;             ///< not owned; may be null
  InnerDescent* inner_descent = nullptr;  ///< not owned; null: none
  /// Of kIterativeSchur: these variables are eliminated, of any size and none in a factor with
  /// another, and not the graph's landmarks (LargeBlockSchurModel). Not owned; null: the landmarks.
  const std::vector<VariableId>* eliminated = nullptr;
  StepSystemObserver* system_observer = nullptr;  ///< not owned; may be null
  const Agreement* agreement = nullptr;           ///< not owned; null: one process
  PositionKeeper* keeper = nullptr;               ///< not owned; may be null
  /// Begins after this iteration, at the values the evaluator has: as if the iterations before had
  /// been here. Not owned; null: from the start.
  const LoopPosition* resume = nullptr;

  double MostColumnNorm() const { return judge != nullptr ? judge->MostColumnNorm() : HUGE_VAL; }
};

/// Solver::Solve with these.
INCERES_EXPORT void SolveWith(const SolverOptions& options, const LoopOptions& loop,
                              FactorGraph* graph, Solver* solver, Summary* summary);

}  // namespace inceres::internal
