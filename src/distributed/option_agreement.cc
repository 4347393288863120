// Options of the distributed solver: their names, what is refused, and whether the ranks have the
// same. The last matters as much as the others: ranks that decide by different tolerances would
// part at some iteration, and wait for each other forever.
#include <algorithm>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "distributed/solve_steps.h"

namespace inceres {

const char* ToString(DistributedLinearSolver kind) {
  switch (kind) {
    case DistributedLinearSolver::kAutomatic:
      return "automatic";
    case DistributedLinearSolver::kConjugateGradients:
      return "conjugate_gradients";
    case DistributedLinearSolver::kCholesky:
      return "cholesky";
    case DistributedLinearSolver::kKsp:
      return "ksp";
  }
  return "unknown";
}

// The first option that is refused is named, in the order of this list. What one process checks as
// well is left to SolverOptions::Validate; negated comparisons refuse NaN.
Status DistributedOptions::Validate() const {
  const char* refused =
      solver.strategy == TrustRegionStrategyKind::kSubspaceDogleg
          ? "solver.strategy: kSubspaceDogleg is for one process; use kDogleg"
      // Its Gauss–Newton step is to be exact. kAutomatic may become kCholesky.
      : solver.strategy == TrustRegionStrategyKind::kDogleg &&
              (linear_solver == DistributedLinearSolver::kConjugateGradients ||
               linear_solver == DistributedLinearSolver::kKsp)
          ? "solver.strategy: kDogleg takes exact steps, of kCholesky; use kLevenbergMarquardt or "
            "kMarquardt"
      : solver.linear_model != LinearModelKind::kAutomatic
          ? "solver.linear_model: stays kAutomatic; linear_solver takes its place"
      : solver.reduced_solver != ReducedSolverKind::kAutomatic || solver.reduced_solver_factory
          ? "solver.reduced_solver: stays kAutomatic; linear_solver takes its place"
      : solver.refine_landmarks    ? "solver.refine_landmarks is for one process"
      : solver.dynamic_sparsity    ? "solver.dynamic_sparsity is for one process"
      : solver.recompute_jacobians ? "solver.recompute_jacobians is for one process"
      : solver.max_memory_bytes != 0
          ? "solver.max_memory_bytes is for one process: nobody counts what the ranks take"
      : solver.use_nonmonotonic_steps && !checkpoint.path.empty()
          ? "solver.use_nonmonotonic_steps: a checkpoint does not remember the costs before"
      : solver.reduce_curvature_of_losses && !checkpoint.path.empty()
          ? "solver.reduce_curvature_of_losses: a checkpoint does not remember what the last step "
            "gained"
      // kCholesky forms S in any case; kAutomatic may become either.
      : solver.conjugate_gradients.explicit_schur_complement &&
              (linear_solver == DistributedLinearSolver::kConjugateGradients ||
               linear_solver == DistributedLinearSolver::kAutomatic)
          ? "solver.conjugate_gradients.explicit_schur_complement: with kKsp only, or kCholesky, "
            "which forms S without it"
      // A sum over factors stands for H, and what is solved here is S.
      : solver.conjugate_gradients.preconditioner == PreconditionerKind::kSubset
          ? "solver.conjugate_gradients.preconditioner: kSubset is for one process"
      : solver.conjugate_gradients.preconditioner == PreconditionerKind::kClusterJacobi ||
              solver.conjugate_gradients.preconditioner == PreconditionerKind::kClusterTridiagonal
          ? "solver.conjugate_gradients.preconditioner: clusters are for one process; use kTwoLevel"
      : solver.conjugate_gradients.preconditioner == PreconditionerKind::kTwoLevel &&
              solver.conjugate_gradients.explicit_schur_complement
          ? "solver.conjugate_gradients.preconditioner: kTwoLevel takes S by products"
      : solver.conjugate_gradients.single_precision_jacobians
          ? "solver.conjugate_gradients.single_precision_jacobians is for one process"
      : solver.conjugate_gradients.eta_follows_gradient
          ? "solver.conjugate_gradients.eta_follows_gradient is for one process"
      : !(solver.conjugate_gradients.eta >= 0.0) ? "solver.conjugate_gradients.eta: at least 0"
      : solver.conjugate_gradients.max_iterations <
              std::max(1, solver.conjugate_gradients.min_iterations)
          ? "solver.conjugate_gradients.max_iterations: at least 1, and not below min_iterations"
      : checkpoint.every < 1 ? "checkpoint.every: at least 1"
                             : nullptr;
  if (refused != nullptr) {
    return Status::Error(StatusCode::kInvalidArgument, refused);
  }
  // S that is formed wants no certain preconditioner where PETSc brings its own.
  SolverOptions alike = solver;
  if (linear_solver == DistributedLinearSolver::kKsp) {  // with any preconditioner
    alike.conjugate_gradients.explicit_schur_complement = false;
  }
  return alike.Validate();
}

namespace internal {
namespace {

using Named = std::vector<std::pair<const char*, double>>;

// Paths are compared by a hash as a number: 52 bits of it, which a double holds exactly.
double HashOf(const std::string& text) {
  return static_cast<double>(std::hash<std::string>()(text) >> 12);
}

// What all ranks decide by. Numbers of threads and observers are not in the list: they may differ.
// A new option of the loop must get a row here. All as doubles, in one gathering: flags are 0 and
// 1, kinds their numbers, and integers are exact.
Named Numbers(const DistributedOptions& options) {
  const SolverOptions& s = options.solver;
  const ConjugateGradientsOptions& cg = s.conjugate_gradients;
  return {{"linear_solver", static_cast<double>(options.linear_solver)},
          {"checkpoint.path", HashOf(options.checkpoint.path)},
          {"checkpoint.every", options.checkpoint.every},
          {"checkpoint.resume", HashOf(options.checkpoint.resume)},
          {"strategy", static_cast<double>(s.strategy)},
          {"preconditioner", static_cast<double>(cg.preconditioner)},
          {"eta", cg.eta},
          {"min_iterations", cg.min_iterations},
          {"max_iterations", cg.max_iterations},
          {"explicit_schur_complement", cg.explicit_schur_complement ? 1.0 : 0.0},
          {"max_num_iterations", s.max_num_iterations},
          {"max_solver_time_in_seconds", s.max_solver_time_in_seconds},
          {"function_tolerance", s.function_tolerance},
          {"gradient_tolerance", s.gradient_tolerance},
          {"parameter_tolerance", s.parameter_tolerance},
          {"initial_trust_region_radius", s.initial_trust_region_radius},
          {"max_trust_region_radius", s.max_trust_region_radius},
          {"min_trust_region_radius", s.min_trust_region_radius},
          {"min_relative_decrease", s.min_relative_decrease},
          {"min_lm_diagonal", s.min_lm_diagonal},
          {"max_lm_diagonal", s.max_lm_diagonal},
          {"max_num_consecutive_invalid_steps", s.max_num_consecutive_invalid_steps},
          {"jacobi_scaling", s.jacobi_scaling ? 1.0 : 0.0},
          {"use_nonmonotonic_steps", s.use_nonmonotonic_steps ? 1.0 : 0.0},
          {"max_consecutive_nonmonotonic_steps", s.max_consecutive_nonmonotonic_steps},
          {"reduce_curvature_of_losses", s.reduce_curvature_of_losses ? 1.0 : 0.0}};
}

}  // namespace

// Collective. Every rank sees the numbers of all, so all find the same first difference, and need
// not agree once more. Exact comparison is right: options are given, not computed.
Status AgreeOnOptions(const Communicator& ranks, const DistributedOptions& options) {
  Status status = ranks.Try([&] { return options.Validate(); });
  if (!status.ok()) {
    return status;
  }
  const Named own = Numbers(options);
  std::vector<double> numbers;
  for (const auto& [name, number] : own) {
    numbers.push_back(number);
  }
  const std::vector<double> all = ranks.GatherAll(numbers);
  for (std::size_t k = 0; k < all.size(); ++k) {
    // The numbers of rank r begin at r times their count.
    const std::size_t option = k % own.size();
    if (all[k] != all[option]) {
      return Status::Error(StatusCode::kInvalidArgument,
                           std::string("the ranks have different options: ") + own[option].first +
                               " is not the same on rank 0 and rank " +
                               std::to_string(k / own.size()));
    }
  }
  return Status::Ok();
}

}  // namespace internal
}  // namespace inceres
