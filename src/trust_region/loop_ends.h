#pragma once

#include <initializer_list>
#include <string>

#include "inceres/solver/options.h"
#include "inceres/solver/solver.h"
#include "inceres/solver/summary.h"
#include "trust_region/loop_options.h"

namespace inceres::internal {

/// How the trust-region loop ends, in Ceres's order and words (docs/ceres_contract.md,
/// "Trust-region loop"). Each of these has ended the solve, with termination and message in the
/// summary, where it says so.

/// Ends it like this; false, for the loop does not go on.
bool EndSolve(Termination termination, std::initializer_list<const char*> words, Summary* summary);

/// Between two iterations: time, number of iterations, gradient and least radius. False: ended.
bool GoesOnAfter(const IterationSummary& iteration, double elapsed_seconds,
                 const SolverOptions& options, const LoopOptions& loop, Summary* summary);

/// A step that short next to the state. True: ended.
bool EndsByParameterTolerance(double step_norm, double state_norm, double tolerance,
                              Summary* summary);

/// A step whose gain is that small next to what of the cost can change. True: ended, without it.
bool EndsByFunctionTolerance(double cost_change, double cost, double fixed_cost, double tolerance,
                             Summary* summary);

/// Whether an observer lets a solve go on. If not, the solve ends like this, in Ceres's words.
inline bool GoesOn(ObserverAction action, Termination* termination, std::string* message) {
  switch (action) {
    case ObserverAction::kTerminateSuccessfully:
      *termination = Termination::kUserSuccess;
      *message = "User callback returned SOLVER_TERMINATE_SUCCESSFULLY.";
      return false;
    case ObserverAction::kAbort:
      *termination = Termination::kUserFailure;
      *message = "User callback returned SOLVER_ABORT.";
      return false;
    case ObserverAction::kContinue:
      break;
  }
  return true;
}

}  // namespace inceres::internal
