#pragma once

#include "inceres/solver/incremental_solver.h"
#include "support/values_held.h"

namespace inceres::test {

inline SolverOptions BatchOptions(double function_tolerance, int max_num_iterations) {
  SolverOptions options;
  options.function_tolerance = function_tolerance;
  options.parameter_tolerance = options.gradient_tolerance = 0.0;
  options.max_num_iterations = max_num_iterations;
  return options;
}

/// How many claims there were, and how many of them were more than ten tolerances above where
/// fifteen steps go that no tolerance ends.
struct Claims {
  static constexpr double kExcess = 10.0;  // tolerances
  // Below that a cost is rounding, and so is what is left of it.
  static constexpr double kNoCost = 1e-20;

  void Judge(FactorGraph* end, double cost, double function_tolerance) {
    SolverOptions options = BatchOptions(0.0, 15);
    options.initial_trust_region_radius = 1e10;
    ++count;
    too_high += cost > kNoCost &&
                cost - Solve(options, end).final_cost > kExcess * function_tolerance * cost;
  }
  int count = 0;
  int too_high = 0;
};

inline IncrementalOptions Incremental() {
  IncrementalOptions options;
  options.batch_share = 1.0;
  options.max_num_iterations = 100;
  return options;
}

/// An Update. What rests on refusals says so, and is not counted.
inline void UpdateAndJudge(IncrementalSolver* solver, double function_tolerance, Claims* claims) {
  const UpdateSummary summary = solver->Update();
  if (summary.termination == Termination::kConvergence && !summary.rests_on_refusals) {
    FactorGraph end = AtValuesHeld(*solver);
    claims->Judge(&end, summary.final_cost, function_tolerance);
  }
}

/// The same from where it begins, by the batch solver.
inline void SolveAndJudge(const IncrementalSolver& solver, double function_tolerance,
                          Claims* claims) {
  FactorGraph graph = AtValuesHeld(solver);
  const Summary summary = Solve(BatchOptions(function_tolerance, 100), &graph);
  if (summary.termination == Termination::kConvergence) {
    claims->Judge(&graph, summary.final_cost, function_tolerance);
  }
}

}  // namespace inceres::test
