#include "trust_region/loop_ends.h"

#include <cmath>
#include <string>

#include "base/scientific.h"

namespace inceres::internal {

// Ends of the loop (docs/ceres_contract.md, "Termination and messages"). The words and the way
// numbers are printed are Ceres's to the letter, for programs may compare them. The tests between
// iterations come in its order, so that of two that hold the same one is reported.

bool EndSolve(Termination termination, std::initializer_list<const char*> words, Summary* summary) {
  summary->termination = termination;
  summary->message.clear();
  summary->message.reserve(120);  // as long as most
  for (const char* word : words) {
    summary->message += word;
  }
  return false;
}

// After an iteration was recorded and shown to callbacks. Limits come before convergence.
bool GoesOnAfter(const IterationSummary& iteration, double elapsed_seconds,
                 const SolverOptions& options, const LoopOptions& loop, Summary* summary) {
  // The time of the caller's before this solve counts as well.
  if (elapsed_seconds >= options.max_solver_time_in_seconds) {
    return EndSolve(
        Termination::kNoConvergence,
        {"Maximum solver time reached. Total solver time: ", Scientific(elapsed_seconds).text(),
         " >= ", Scientific(options.max_solver_time_in_seconds).text(), "."},
        summary);
  }
  if (iteration.iteration >= options.max_num_iterations) {
    return EndSolve(Termination::kNoConvergence,
                    {"Maximum number of iterations reached. Number of iterations: ",
                     std::to_string(iteration.iteration).c_str(), "."},
                    summary);
  }
  // Ceres has it negated, by which NaN is small.
  const double norm = iteration.gradient_max_norm;
  const bool is_small =
      norm <= options.gradient_tolerance || (loop.nan_gradient_is_small && std::isnan(norm));
  // Only a step that was taken has a gradient of its own.
  if (iteration.step_is_successful && is_small) {
    return EndSolve(Termination::kConvergence,
                    {"Gradient tolerance reached. Gradient max norm: ",
                     Scientific(iteration.gradient_max_norm).text(),
                     " <= ", Scientific(options.gradient_tolerance).text()},
                    summary);
  }
  if (iteration.trust_region_radius <= options.min_trust_region_radius) {
    return EndSolve(Termination::kConvergence,
                    {"Minimum trust region radius reached. Trust region radius: ",
                     Scientific(iteration.trust_region_radius).text(),
                     " <= ", Scientific(options.min_trust_region_radius).text()},
                    summary);
  }
  return true;
}

// Asked before the candidate is accepted, as in Ceres, and without a look at its cost.
bool EndsByParameterTolerance(double step_norm, double state_norm, double tolerance,
                              Summary* summary) {
  // Written as Ceres does: NaN ends the solve.
  if (step_norm > tolerance * (state_norm + tolerance)) {
    return false;
  }
  EndSolve(Termination::kConvergence,
           {"Parameter tolerance reached. Relative step_norm: ",
            Scientific(step_norm / (state_norm + tolerance)).text(),
            " <= ", Scientific(tolerance).text(), "."},
           summary);
  return true;
}

// Small increases count as well: the candidate need not be better.
bool EndsByFunctionTolerance(double cost_change, double cost, double fixed_cost, double tolerance,
                             Summary* summary) {
  // Written so that a NaN cost counts as converged (CeresRules::k21).
  if (std::fabs(cost_change) > tolerance * (cost - fixed_cost)) {
    return false;
  }
  // The candidate is discarded, its gain is reported only.
  summary->discarded_cost_change = cost_change;
  // What is printed is relative to the whole cost, which fixed factors are part of.
  EndSolve(Termination::kConvergence,
           {"Function tolerance reached. |cost_change|/cost: ",
            Scientific(std::fabs(cost_change) / cost).text(), " <= ", Scientific(tolerance).text()},
           summary);
  return true;
}

}  // namespace inceres::internal
