#pragma once

#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "linear/block_rows.h"

namespace inceres::internal {

/// The block rows of a batch solve in the order in which the solver's factor eliminates them; empty
/// if it has none that is known: of conjugate gradients, of a user's solver, before Analyze.
std::vector<int> EliminationOrderOf(const ReducedSolver& solver);

/// The same of the solver of an incremental solve, by the rows of S. Of what it factored last.
std::vector<int> EliminationOrderOf(const ReducedSolver& solver, const SymmetricBlockRows& S);

}  // namespace inceres::internal
