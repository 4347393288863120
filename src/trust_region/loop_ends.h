#pragma once

#include <initializer_list>

#include "inceres/solver/options.h"
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

}  // namespace inceres::internal
