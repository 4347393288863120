#pragma once

#include <string>
#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/solve_input.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/options.h"

namespace inceres::internal {

/// Threads that may read the problem: as NumThreads, and nothing is said.
int NumReaders(const ceres::Solver::Options& options);

/// min(options.num_threads, what the machine has), with a warning if that is less, as in Ceres.
int NumThreads(const ceres::Solver::Options& options);

/// The core's options for the same solve. `type` is the effective linear solver. Left to the
/// caller: num_threads, observer.
SolverOptions MapOptions(const ceres::Solver::Options& options, ceres::LinearSolverType type);

/// Names of the options that the user set away from their defaults and that change nothing in a
/// solve by the core. `is_constrained`: some variable block has bounds.
std::vector<std::string> OptionsWithoutEffect(const ceres::Solver::Options& options,
                                              const LandmarkCounts& landmarks, bool is_constrained);

/// The options of an incremental solve: `core`, with what the user's options say in its place. The
/// damping starts at 1 / initial_trust_region_radius, as Ceres's Levenberg-Marquardt does.
IncrementalOptions MapIncrementalOptions(const ceres::Solver::Options& options,
                                         const IncrementalOptions& core);

/// Whether the batch solver of an incremental solve by these core options (IncrementalOptionsFor)
/// may take conjugate gradients, with the user's eta and limits.
bool IteratesInBatch(const ceres::Solver::Options& options, const IncrementalOptions& core);

/// Names of the options that the user set away from their defaults and that change nothing in an
/// incremental solve. `iterates_in_batch`: IteratesInBatch.
std::vector<std::string> IncrementalOptionsWithoutEffect(const ceres::Solver::Options& options,
                                                         const LandmarkCounts& landmarks,
                                                         bool iterates_in_batch = false);

/// Reduced systems of up to so many unknowns are solved directly even if an iterative solver was
/// asked for: were their factor full, it would take 256 MiB.
inline constexpr int kMaxDirectSize = 8192;

/// What ITERATIVE_SCHUR and CGNR mean in incremental mode for a problem of more than
/// `max_direct_size` unknowns, of which as many are in the reduced system: preconditioned conjugate
/// gradients, from the first step on. Where ITERATIVE_SCHUR has landmarks to eliminate the batch
/// solver still goes first, and takes what is predicted to take least of its own solvers. Smaller
/// ones: nothing. Neither do they mean anything where `core` names a solver itself. Cost: that of
/// choosing landmarks, if there are that many unknowns.
void ChooseIterativeSolver(const ceres::Solver::Options& options, const ProblemView& view,
                           const OrderingView& ordering, int max_direct_size,
                           IncrementalOptions* core);

/// The options of an incremental solve of this problem: `core`, with what the user's options and
/// what he has asked of this solve say in its place.
IncrementalOptions IncrementalOptionsFor(const SolveInput& input, const IncrementalOptions& core);

}  // namespace inceres::internal
