#pragma once

#include <mpi.h>

#include <memory>

#include "inceres/distributed/graph_part.h"
#include "inceres/distributed/options.h"
#include "inceres/distributed/summary.h"

namespace inceres {

/// The batch solver on several processes: minimizes the cost of all parts together by the
/// trust-region loop of inceres::Solve, with its decisions, taken from sums that are the same to
/// the bit on all ranks. Families, losses and manifolds are those of any graph.
///
/// Each rank linearizes its factors, eliminates its landmarks and substitutes them; the reduced
/// system of the frames is solved by all (DistributedLinearSolver). What the ranks exchange is the
/// frames they share, a few numbers an iteration, and of each frame 48 bytes once, to all ranks.
///
/// All calls are collective: every rank of the communicator makes them, in the same order, and
/// returns from them together. A failure on any rank is one on all: the message begins with "rank
/// R: ", names factor, variable, frame or option, and all graphs are as before. That goes for
/// factors that fail, or throw, or give NaN; a process that dies takes the others with it, as MPI
/// does it. The same ranks and parts give the same bits again; others differ by rounding.
///
/// MPI must have been started by MPI_Init or PetscInitialize, or is started by the first
/// constructor, with PETSc. What that has started, both or PETSc alone, is ended at exit, which the
/// ranks then reach together; of MPI that others started and have ended by then, PETSc is left as
/// it is. Threads: one thread of each rank calls; the solver uses SolverOptions::num_threads.
/// Source: Agarwal et al. 2010, "Bundle Adjustment in the Large"; docs/distributed.md.
class DistributedSolver {
 public:
  /// The ranks of `comm` solve together; it is duplicated. Throws std::runtime_error if PETSc
  /// cannot be started.
  DistributedSolver(MPI_Comm comm, DistributedOptions options);
  ~DistributedSolver();
  DistributedSolver(const DistributedSolver&) = delete;
  DistributedSolver& operator=(const DistributedSolver&) = delete;

  /// Minimizes. On a usable solution the values of all variables that move are in the graphs,
  /// those of a frame on all ranks that list it; otherwise no graph is changed.
  ///
  /// Refused with a message: bounds, pinned variables, options that DistributedOptions does not
  /// know, options or shared frames that differ between ranks.
  DistributedSummary Solve(const GraphPart& part);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres
