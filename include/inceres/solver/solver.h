#pragma once

#include "inceres/export.h"
#include "inceres/graph/factor_graph.h"
#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"

namespace inceres {

/// What an observer wants after an iteration.
enum class ObserverAction { kContinue, kTerminateSuccessfully, kAbort };

/// The hooks of the trust-region loop, in the order of Ceres's contract: an observer sees every evaluation before it happens and
/// every iteration after it ended. All calls come from the solving thread. State vectors are laid out like FactorGraph::state().
class INCERES_EXPORT SolveObserver {
 public:
  virtual ~SolveObserver() = default;

  /// Before residuals (and Jacobians, if `jacobians`) are evaluated at `state`. `new_point` is false only when Jacobians are
  /// asked for at the accepted candidate whose cost is already known.
  virtual void BeforeEvaluation(const double* /*state*/, bool /*jacobians*/, bool /*new_point*/) {}

  /// At the end of iteration 0 and of every completed iteration; `best_state` is what a stop here would return.
  virtual ObserverAction EndOfIteration(const IterationSummary& /*summary*/, const double* /*best_state*/) {
    return ObserverAction::kContinue;
  }
};

/// Minimises the graph's cost (factors whose variables are all constant included: put what cannot move into
/// SolverOptions::fixed_cost instead if it should not weigh on the relative tolerances); on a usable solution the graph's state
/// is the best one found, otherwise it is untouched. The summary names what happened.
///
/// Cost: each iteration is linear in factors and block products plus the factorisation of the reduced system. Threads: up to
/// options.num_threads; the result is the same to the last bit for any number.
/// Source: Ceres 2.1's trust-region minimiser, restated in design terms in algorithms.md sections 1, 4 and 6.
INCERES_EXPORT Summary Solve(const SolverOptions& options, FactorGraph* graph);

}  // namespace inceres
