#include "inceres/solver/options.h"

#include <algorithm>

#include "base/option_rules.h"
#include "trust_region/strategy.h"

namespace inceres {

// Options that make no sense are told before anything is evaluated. The order is fixed: of several
// the first one is told.

namespace {

using internal::OptionRules;

// Preconditioners whose blocks are grouped by which landmarks frames see.
bool NeedsLandmarks(PreconditionerKind kind) {
  return kind == PreconditionerKind::kTwoLevel || kind == PreconditionerKind::kClusterJacobi ||
         kind == PreconditionerKind::kClusterTridiagonal;
}

}  // namespace

// Summary::strategy has these names.
const char* ToString(TrustRegionStrategyKind kind) {
  switch (kind) {
    case TrustRegionStrategyKind::kLevenbergMarquardt:
      return "levenberg_marquardt";
    case TrustRegionStrategyKind::kMarquardt:
      return "marquardt";
    case TrustRegionStrategyKind::kDogleg:
      return "dogleg";
    case TrustRegionStrategyKind::kSubspaceDogleg:
      return "subspace_dogleg";
  }
  return "unknown";
}

namespace {

// What an iterative linear_model asks of the others.
Status CheckIterative(const SolverOptions& options) {
  const ConjugateGradientsOptions& cg = options.conjugate_gradients;
  const bool iterative = IsIterative(options.linear_model);
  // kAutomaticInexact may take conjugate gradients once the graph is known: what they are told must
  // make sense in either case, and what only one kind of linear_model is told need not.
  const bool maybe = iterative || (options.linear_model == LinearModelKind::kAutomatic &&
                                   options.reduced_solver == ReducedSolverKind::kAutomaticInexact);
  return OptionRules("SolverOptions")
      .Require(!iterative || internal::IsDamped(options.strategy), "strategy",
               static_cast<double>(options.strategy),
               "Levenberg–Marquardt or Marquardt with an iterative linear_model")
      .Require(!maybe || cg.eta >= 0.0, "conjugate_gradients.eta", cg.eta, ">= 0")
      .Require(!maybe || cg.min_iterations >= 0, "conjugate_gradients.min_iterations",
               cg.min_iterations, ">= 0")
      .Require(!maybe || cg.max_iterations >= std::max(1, cg.min_iterations),
               "conjugate_gradients.max_iterations", cg.max_iterations,
               ">= 1 and not below min_iterations")
      // Ceres's rule for SCHUR_JACOBI; two levels, which Ceres has not, go with either.
      .Require(!iterative || !cg.explicit_schur_complement ||
                   cg.preconditioner == PreconditionerKind::kSchurJacobi ||
                   cg.preconditioner == PreconditionerKind::kTwoLevel,
               "conjugate_gradients.explicit_schur_complement", cg.explicit_schur_complement,
               "false without preconditioner kSchurJacobi or kTwoLevel")
      .Require(!cg.single_precision_jacobians ||
                   options.linear_model == LinearModelKind::kIterativeSchur,
               "conjugate_gradients.single_precision_jacobians", cg.single_precision_jacobians,
               "false without linear_model kIterativeSchur")
      // CGNR eliminates nothing: there are no landmarks to group frames by.
      .Require(options.linear_model != LinearModelKind::kIterativePlain ||
                   !NeedsLandmarks(cg.preconditioner),
               "conjugate_gradients.preconditioner", static_cast<double>(cg.preconditioner),
               "another: by aggregates or clusters with linear_model kIterativeSchur only")
      .Require(
          // A sum over factors approximates H, which is S only where nothing is eliminated.
          !iterative || cg.preconditioner != PreconditionerKind::kSubset ||
              (cg.subset != nullptr && options.linear_model == LinearModelKind::kIterativePlain),
          "conjugate_gradients.preconditioner", "kSubset",
          "with a subset, and with linear_model kIterativePlain")
      .status();
}

// How far a step may go, and which steps are taken.
Status CheckTrustRegion(const SolverOptions& options) {
  return OptionRules("SolverOptions")
      .Require(options.min_trust_region_radius > 0.0, "min_trust_region_radius",
               options.min_trust_region_radius, "> 0")
      .Require(options.max_trust_region_radius >= options.min_trust_region_radius,
               "max_trust_region_radius", options.max_trust_region_radius,
               ">= min_trust_region_radius")
      .Require(options.initial_trust_region_radius >= options.min_trust_region_radius &&
                   options.initial_trust_region_radius <= options.max_trust_region_radius,
               "initial_trust_region_radius", options.initial_trust_region_radius,
               "between min_trust_region_radius and max_trust_region_radius")
      .NotNegative("min_relative_decrease", options.min_relative_decrease)
      // Above zero, since it is what makes H + Λ positive definite where a column of J is zero.
      .Positive("min_lm_diagonal", options.min_lm_diagonal)
      .Require(options.max_lm_diagonal >= options.min_lm_diagonal, "max_lm_diagonal",
               options.max_lm_diagonal, ">= min_lm_diagonal")
      .NotNegative("max_num_consecutive_invalid_steps", options.max_num_consecutive_invalid_steps)
      // A window of 0 is the monotonic rule.
      .Require(!options.use_nonmonotonic_steps || options.max_consecutive_nonmonotonic_steps > 0,
               "max_consecutive_nonmonotonic_steps", options.max_consecutive_nonmonotonic_steps,
               "> 0 with use_nonmonotonic_steps")
      .status();
}

// How steps are shortened where there are bounds.
Status CheckLineSearch(const SolverOptions& options) {
  return OptionRules("SolverOptions")
      .Require(options.line_search_sufficient_function_decrease > 0.0 &&
                   options.line_search_sufficient_function_decrease < 1.0,
               "line_search_sufficient_function_decrease",
               options.line_search_sufficient_function_decrease, "between 0 and 1")
      // Ceres's names: the factor of the largest contraction is the smaller number of the two.
      .Require(options.max_line_search_step_contraction > 0.0 &&
                   options.max_line_search_step_contraction < 1.0,
               "max_line_search_step_contraction", options.max_line_search_step_contraction,
               "between 0 and 1")
      .Require(
          options.min_line_search_step_contraction > options.max_line_search_step_contraction &&
              options.min_line_search_step_contraction <= 1.0,
          "min_line_search_step_contraction", options.min_line_search_step_contraction,
          "above max_line_search_step_contraction, at most 1")
      .Positive("min_line_search_step_size", options.min_line_search_step_size)
      // 0: steps are not shortened.
      .Require(options.max_num_line_search_step_size_iterations >= 0,
               "max_num_line_search_step_size_iterations",
               options.max_num_line_search_step_size_iterations, ">= 0")
      .status();
}

}  // namespace

// Without a look at a graph: what depends on one is told where the model is made.
Status SolverOptions::Validate() const {
  return OptionRules("SolverOptions")
      // The pattern is made anew at each linearization, of H as a whole: nothing is eliminated, and
      // no QR or iteration is set up for it.
      .Require(!dynamic_sparsity || linear_model == LinearModelKind::kAutomatic ||
                   linear_model == LinearModelKind::kPlain,
               "dynamic_sparsity", dynamic_sparsity,
               "false with linear_model kSchur, kDenseQr or an iterative one")
      .Also(CheckIterative(*this))
      // Resuming needs to know which rows an edit has changed.
      .Require(reduced_solver != ReducedSolverKind::kResumed, "reduced_solver",
               static_cast<double>(reduced_solver), "another: kResumed is for IncrementalSolver")
      .Require(num_threads >= 1 && num_threads <= 1024, "num_threads", num_threads,
               "between 1 and 1024")
      .Require(max_memory_bytes >= 0, "max_memory_bytes", static_cast<double>(max_memory_bytes),
               ">= 0")
      .Require(!recompute_jacobians ||
                   (!IsIterative(linear_model) && linear_model != LinearModelKind::kDenseQr &&
                    !dynamic_sparsity && !refine_landmarks),
               "recompute_jacobians", recompute_jacobians,
               "false with linear_model kDenseQr or an iterative one, dynamic_sparsity or "
               "refine_landmarks")
      .NotNegative("max_num_iterations", max_num_iterations)
      .NotNegative("max_solver_time_in_seconds", max_solver_time_in_seconds)
      // Of tolerances 0 is allowed: such a test is passed only by no change at all.
      .NotNegative("function_tolerance", function_tolerance)
      .NotNegative("gradient_tolerance", gradient_tolerance)
      .NotNegative("parameter_tolerance", parameter_tolerance)
      .Also(CheckTrustRegion(*this))
      .Also(CheckLineSearch(*this))
      .status();
}

}  // namespace inceres
