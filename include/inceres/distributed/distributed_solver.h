#pragma once

#include <mpi.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "inceres/status.h"

namespace inceres {

/// A variable by the name that all ranks know it by.
struct GlobalVariable {
  std::int64_t id = -1;      ///< ≥ 0, the same on all ranks
  VariableId variable = -1;  ///< what the graph of this rank calls it
};

/// The part of a problem that one rank of a DistributedSolver has.
///
/// Its landmarks are its own, with all their factors; frames it may share. Each frame that a factor
/// touches and that is not constant is listed in `frames`. Ranks that list the same frame start
/// from the same values, with the same manifold, and hold it constant all or none of them. Factors
/// between frames (priors, IMU, relative poses) are on one rank each, whichever lists the frames. A
/// constant needs no id. A rank may have no landmarks, no factors, nothing.
struct GraphPart {
  FactorGraph* graph = nullptr;        ///< written by a solve; outlives it
  std::vector<GlobalVariable> frames;  ///< in any order, each once
  /// For checkpoints only (DistributedOptions::checkpoint): all landmarks that move, each once and
  /// on one rank; ids may equal those of frames.
  std::vector<GlobalVariable> landmarks;
};

/// How the reduced system S δ_c = b of all ranks is solved.
enum class DistributedLinearSolver {
  /// kCholesky where the factor of S is predicted to be small, else kConjugateGradients
  kAutomatic,
  /// SolverOptions::conjugate_gradients, by products with the parts of S that each rank has; one
  /// exchange of shared frames and one reduction an iteration
  kConjugateGradients,
  /// S formed, and factored by MUMPS
  kCholesky,
  /// what PETSc's options of prefix `inceres_` say (-inceres_ksp_type, -inceres_pc_type, …): its
  /// CG with conjugate_gradients.preconditioner unless told otherwise, by default blocks of C + Λ,
  /// until the residual is a share eta of b, or for max_iterations; min_iterations is ignored. S is
  /// a shell; with conjugate_gradients.explicit_schur_complement it is formed, and preconditioners
  /// have its entries
  kKsp,
};

/// "automatic", "conjugate_gradients", "cholesky", "ksp".
const char* ToString(DistributedLinearSolver kind);

/// A file that holds where a solve is, to go on from there after it was ended.
struct CheckpointOptions {
  /// where to write; empty: nowhere. Written as `path`.partial by all ranks and renamed, so that
  /// what has the name is whole. A file system that all ranks see.
  std::string path;
  int every = 5;  ///< iterations; ≥ 1
  /// Goes on from this file, if not empty: it must be there, whole, and of the same problem.
  std::string resume;
};

/// Options of a DistributedSolver; the same on all ranks, but for num_threads, progress, callback
/// and observer.
struct DistributedOptions {
  /// As of a batch solve in one process: strategy (not kSubspaceDogleg; kDogleg with kCholesky
  /// only), conjugate_gradients (neither clusters, kSubset, eta_follows_gradient nor
  /// single_precision_jacobians; explicit_schur_complement with kKsp only, or with kCholesky, which
  /// forms S without it), num_threads (of each rank), tolerances and radii, progress, callback,
  /// observer. linear_model and reduced_solver stay kAutomatic: linear_solver takes their place.
  /// refine_landmarks, dynamic_sparsity, recompute_jacobians and max_memory_bytes are refused; with
  /// a checkpoint to write use_nonmonotonic_steps and reduce_curvature_of_losses too.
  SolverOptions solver;
  DistributedLinearSolver linear_solver = DistributedLinearSolver::kAutomatic;  ///< see there
  CheckpointOptions checkpoint;                                                 ///< see there

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// What one rank had to do.
struct RankReport {
  std::int64_t num_factors = 0;          ///< of its graph
  std::int64_t num_landmarks = 0;        ///< that move
  std::int64_t num_frames = 0;           ///< that its factors touch and that move
  std::int64_t num_shared_frames = 0;    ///< of them those that other ranks' factors touch too
  std::int64_t num_owned_frames = 0;     ///< whose rows it sums
  std::int64_t bytes = 0;                ///< of the solver's arrays
  std::int64_t peak_resident_bytes = 0;  ///< of the process, so far; 0 where that is not known
  /// of a product with S: what it sends to others, by the plan; and of the reductions of an
  /// iteration of conjugate gradients, what it has for all others
  std::int64_t exchange_bytes_per_product = 0;
  /// values of the frames it shares: what exchange_bytes_per_product compares with
  std::int64_t shared_frame_bytes = 0;
  std::int64_t num_products = 0;  ///< with S
  /// from the begin of the iterations to their end, in messages to one other rank: of frames, as
  /// PETSc counts them, of blocks of S that is formed, of the two-level preconditioner
  std::int64_t bytes_sent = 0;
  std::int64_t reduction_bytes_sent = 0;  ///< in reductions, which are gatherings of a few numbers
  double seconds = 0.0;                   ///< of the whole solve
  double product_seconds = 0.0;           ///< of it in products with S
  double exchange_seconds = 0.0;          ///< of it in messages, waiting included
  double reduction_seconds = 0.0;         ///< of it in reductions, waiting included
};

/// What happened, the same on all ranks but for times and bytes of `solve`, which are each rank's
/// own.
struct DistributedSummary {
  /// Sizes are those of all ranks together; num_variables and num_values count a frame once for
  /// each rank that lists it.
  Summary solve;
  std::vector<RankReport> ranks;  ///< of all ranks, by number
  /// Largest number of factors of a rank over the mean; 1: all have as many.
  double imbalance = 1.0;
  int num_checkpoints = 0;  ///< written
  /// Why the last checkpoint that could not be written was not: the solve went on without it. Empty
  /// if there was none.
  std::string checkpoint_failure;
};

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
