#pragma once

#include <string>

#include "inceres/solver/options.h"
#include "inceres/status.h"

namespace inceres {

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

}  // namespace inceres
