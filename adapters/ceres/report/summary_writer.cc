#include "adapters/ceres/report/summary_writer.h"

#include <algorithm>
#include <array>
#include <climits>
#include <iterator>
#include <utility>
#include <vector>

#include <glog/logging.h>

#include "adapters/ceres/read/ceres_version.h"

namespace inceres::internal {
namespace {

ceres::TerminationType ToCeres(Termination termination) {
  switch (termination) {
    case Termination::kConvergence:
      return ceres::CONVERGENCE;
    case Termination::kNoConvergence:
      return ceres::NO_CONVERGENCE;
    case Termination::kUserSuccess:
      return ceres::USER_SUCCESS;
    case Termination::kUserFailure:
      return ceres::USER_FAILURE;
    case Termination::kFailure:
      break;
  }
  return ceres::FAILURE;
}

void WriteOptions(const ceres::Solver::Options& options, ceres::Solver::Summary* summary) {
  summary->minimizer_type = options.minimizer_type;
  summary->trust_region_strategy_type = options.trust_region_strategy_type;
  summary->dogleg_type = options.dogleg_type;
  summary->dense_linear_algebra_library_type = options.dense_linear_algebra_library_type;
  summary->sparse_linear_algebra_library_type = options.sparse_linear_algebra_library_type;
  summary->visibility_clustering_type = options.visibility_clustering_type;
  summary->line_search_direction_type = options.line_search_direction_type;
  summary->line_search_type = options.line_search_type;
  summary->line_search_interpolation_type = options.line_search_interpolation_type;
  summary->nonlinear_conjugate_gradient_type = options.nonlinear_conjugate_gradient_type;
  summary->max_lbfgs_rank = options.max_lbfgs_rank;
  summary->linear_solver_type_given = options.linear_solver_type;
  summary->preconditioner_type_given = options.preconditioner_type;
  summary->preconditioner_type_used = options.preconditioner_type;
  summary->num_threads_given = options.num_threads;
  summary->inner_iterations_given = options.use_inner_iterations;
  summary->linear_solver_ordering_given = GroupSizes(options.linear_solver_ordering.get());
  summary->inner_iteration_ordering_given = GroupSizes(options.inner_iteration_ordering.get());
  summary->inner_iteration_ordering_used = summary->inner_iteration_ordering_given;
  WriteOptionsOfThisRelease(options, summary);
}

// The two strings of ceres::Solver::Summary that name the block sizes of a Schur problem:
// "residual,landmark,frame" in tangent sizes, "d" where they vary, over the residual blocks that
// touch a landmark; zeros if none does.
struct SchurStructure {
  std::string given;  // as found in the problem
  std::string used;  // the closest of the specializations Ceres would pick (which ours need not be)
};

constexpr int kDynamic = -1;
using Sizes = std::array<int, 3>;  // residual, landmark, frame

// Merges one more size into what was seen so far (0: nothing yet).
void Merge(int size, int* seen) {
  if (*seen == 0) {
    *seen = size;
  } else if (*seen != size) {
    *seen = kDynamic;
  }
}

std::string ToText(const Sizes& sizes) {
  std::string text;
  for (const int size : sizes) {
    text +=
        (text.empty() ? "" : ",") + (size == kDynamic ? std::string("d") : std::to_string(size));
  }
  return text;
}

// Of the template specializations Ceres has, from 2.0 to 2.2, if it was built with any.
Sizes BestSpecialization(const Sizes& sizes) {
  if (!kCeresHasSchurSpecializations) {
    return {kDynamic, kDynamic, kDynamic};
  }
  constexpr Sizes kExact[] = {{2, 2, 2}, {2, 2, 3}, {2, 2, 4}, {2, 3, 3}, {2, 3, 4}, {2, 3, 6},
                              {2, 3, 9}, {2, 4, 3}, {2, 4, 4}, {2, 4, 6}, {2, 4, 8}, {2, 4, 9},
                              {3, 3, 3}, {4, 4, 2}, {4, 4, 3}, {4, 4, 4}};
  if (std::find(std::begin(kExact), std::end(kExact), sizes) != std::end(kExact)) {
    return sizes;
  }
  if ((sizes[0] == 2 && sizes[1] >= 2 && sizes[1] <= 4) || (sizes[0] == 4 && sizes[1] == 4)) {
    return {sizes[0], sizes[1], kDynamic};
  }
  return sizes[0] == 2 ? Sizes{2, kDynamic, kDynamic} : Sizes{kDynamic, kDynamic, kDynamic};
}

SchurStructure FindSchurStructure(const ProblemView& view, const LandmarkSelection& landmarks) {
  Sizes sizes = {0, 0, 0};
  for (const ResidualBlockView& residual : view.residuals) {
    const int* slots = view.SlotsOf(residual);
    const int landmark = view.FindSlot(residual, [&](int b) { return landmarks.Contains(b); });
    if (residual.fixed || landmark < 0) {
      continue;
    }
    Merge(residual.num_residuals, &sizes[0]);
    Merge(view.block(slots[landmark]).tangent_size, &sizes[1]);
    for (int s = 0; s < residual.num_slots; ++s) {
      if (s != landmark && !view.block(slots[s]).constant) {
        Merge(view.block(slots[s]).tangent_size, &sizes[2]);
      }
    }
  }
  return {ToText(sizes), ToText(BestSpecialization(sizes))};
}

}  // namespace

ceres::IterationSummary ToCeres(const IterationSummary& iteration, double eta) {
  ceres::IterationSummary result;
  result.iteration = iteration.iteration;
  result.step_is_valid = iteration.step_is_valid;
  result.step_is_nonmonotonic = iteration.step_is_nonmonotonic;
  result.step_is_successful = iteration.step_is_successful;
  result.cost = iteration.cost;
  result.cost_change = iteration.cost_change;
  result.gradient_max_norm = iteration.gradient_max_norm;
  result.gradient_norm = iteration.gradient_norm;
  result.step_norm = iteration.step_norm;
  result.relative_decrease = iteration.relative_decrease;
  result.trust_region_radius = iteration.trust_region_radius;
  result.eta = iteration.iteration == 0 || !iteration.step_is_valid ? eta : 0.0;
  result.linear_solver_iterations = iteration.linear_solver_iterations;
  result.iteration_time_in_seconds = iteration.iteration_time_in_seconds;
  result.step_solver_time_in_seconds = iteration.step_solver_time_in_seconds;
  result.cumulative_time_in_seconds = iteration.cumulative_time_in_seconds;
  return result;
}

void WriteGiven(const ceres::Solver::Options& options, const ProblemView& view,
                ceres::Solver::Summary* summary) {
  WriteOptions(options, summary);
  summary->num_parameter_blocks = view.all.num_parameter_blocks;
  summary->num_parameters = view.all.num_parameters;
  summary->num_effective_parameters = view.all.num_effective_parameters;
  summary->num_residual_blocks = view.all.num_residual_blocks;
  summary->num_residuals = view.all.num_residuals;
  summary->num_line_search_steps = 0;
  summary->line_search_cost_evaluation_time_in_seconds = 0.0;
  summary->line_search_gradient_evaluation_time_in_seconds = 0.0;
  summary->line_search_polynomial_minimization_time_in_seconds = 0.0;
  summary->line_search_total_time_in_seconds = 0.0;
  summary->inner_iteration_time_in_seconds = 0.0;
}

void WriteSolution(double eta, const Summary& core, ceres::Solver::Summary* summary) {
  summary->termination_type = ToCeres(core.termination);
  summary->message = core.message;
  summary->iterations.reserve(core.iterations.size());
  summary->initial_cost = core.initial_cost;
  // As in Ceres a minimum over the trace: rejected steps included.
  summary->final_cost = core.initial_cost;
  for (const IterationSummary& iteration : core.iterations) {
    summary->iterations.push_back(ToCeres(iteration, eta));
    summary->final_cost = std::min(summary->final_cost, iteration.cost);
  }
  summary->is_constrained = core.is_constrained;
  summary->num_line_search_steps = core.line_search.num_steps;
  summary->line_search_cost_evaluation_time_in_seconds = core.line_search.cost_seconds;
  summary->line_search_gradient_evaluation_time_in_seconds = core.line_search.gradient_seconds;
  summary->line_search_polynomial_minimization_time_in_seconds =
      core.line_search.polynomial_seconds;
  summary->line_search_total_time_in_seconds = core.line_search.total_seconds;
  summary->num_successful_steps = core.num_successful_steps;
  summary->num_unsuccessful_steps = core.num_unsuccessful_steps;
  summary->num_linear_solves = core.work.num_linear_solves;
  summary->num_residual_evaluations = core.work.num_residual_evaluations;
  summary->num_jacobian_evaluations = core.work.num_jacobian_evaluations;
  summary->residual_evaluation_time_in_seconds = core.seconds.residuals;
  summary->jacobian_evaluation_time_in_seconds = core.seconds.jacobians;
  summary->linear_solver_time_in_seconds = core.seconds.hessian + core.seconds.elimination +
                                           core.seconds.factorization +
                                           core.seconds.back_substitution;
}

void WriteNothingToSolve(const SolveInput& input, double fixed_cost,
                         ceres::Solver::Summary* summary) {
  summary->linear_solver_ordering_used = summary->linear_solver_ordering_given;
  summary->preprocessor_time_in_seconds = input.Seconds();
  summary->termination_type = ceres::CONVERGENCE;
  summary->message = "Function tolerance reached. No non-constant parameter blocks found.";
  summary->initial_cost = fixed_cost;
  summary->final_cost = fixed_cost;
}

void WriteEnd(const SolveInput& input, bool preprocessed, ceres::Solver::Summary* summary) {
  const double postprocessor_start = input.Seconds();
  if (preprocessed) {
    const ProblemTotals& reduced = input.view.reduced;
    summary->num_parameter_blocks_reduced = reduced.num_parameter_blocks;
    summary->num_parameters_reduced = reduced.num_parameters;
    summary->num_effective_parameters_reduced = reduced.num_effective_parameters;
    summary->num_residual_blocks_reduced = reduced.num_residual_blocks;
    summary->num_residuals_reduced = reduced.num_residuals;
  }
  summary->total_time_in_seconds = input.Seconds();
  summary->postprocessor_time_in_seconds = summary->total_time_in_seconds - postprocessor_start;
}

void WriteLinearSolver(const ProblemView& view, const OrderingView& ordering,
                       const LandmarkSelection& selection, ceres::LinearSolverType type,
                       ceres::Solver::Summary* summary) {
  const LandmarkSelection landmarks = WithLarge(selection);
  summary->linear_solver_type_used = type;
  summary->preconditioner_type_used = PreconditionerFor(summary->preconditioner_type_given,
                                                        summary->linear_solver_type_given, type);
  const int num_frames = view.reduced.num_parameter_blocks - landmarks.num_landmarks;
  if (!IsSchurType(type)) {
    summary->linear_solver_ordering_used =
        ordering.given ? ordering.group_sizes : std::vector<int>{view.reduced.num_parameter_blocks};
    return;
  }
  const bool given = LandmarksAreGiven(ordering, type);
  const bool differs = given && (landmarks.num_too_large > 0 || landmarks.num_kept > 0);
  const SchurStructure structure = FindSchurStructure(
      view, differs ? LandmarksOfFirstGroup(view, ordering, /*max_size=*/INT_MAX) : landmarks);
  summary->schur_structure_given = structure.given;
  summary->schur_structure_used = structure.used;
  if (given) {  // what the user asked for, even where it is solved in another order
    summary->linear_solver_ordering_used = ordering.group_sizes;
    return;
  }
  for (const int size : {landmarks.num_landmarks, num_frames}) {
    if (size > 0) {
      summary->linear_solver_ordering_used.push_back(size);
    }
  }
}

void LogFailedStep(ceres::LoggingType logging_type, const std::string& failed_step) {
  LOG_IF(WARNING, !failed_step.empty() && logging_type != ceres::SILENT)
      << "Step failed to evaluate. Treating it as a step with infinite cost. The first one of this "
         "solve: "
      << failed_step;
}

void Prepend(const ceres::Solver::Summary& first, ceres::Solver::Summary* summary) {
  summary->initial_cost = first.initial_cost;
  if (summary->termination_type == ceres::FAILURE) {
    summary->final_cost = first.initial_cost;  // where the user's memory is again
  }
  const int start = summary->iterations.empty()
                        ? 0
                        : 1;  // counted with the first part's, for it is where that ended
  summary->num_successful_steps += first.num_successful_steps - start;
  summary->num_unsuccessful_steps += first.num_unsuccessful_steps;
  summary->num_linear_solves += first.num_linear_solves;
  summary->linear_solver_time_in_seconds += first.linear_solver_time_in_seconds;
  summary->residual_evaluation_time_in_seconds += first.residual_evaluation_time_in_seconds;
  summary->jacobian_evaluation_time_in_seconds += first.jacobian_evaluation_time_in_seconds;
  summary->preprocessor_time_in_seconds = first.preprocessor_time_in_seconds;
  summary->minimizer_time_in_seconds = summary->total_time_in_seconds -
                                       first.preprocessor_time_in_seconds -
                                       summary->postprocessor_time_in_seconds;
  std::vector<ceres::IterationSummary> iterations = first.iterations;
  iterations.insert(iterations.end(), summary->iterations.begin() + start,
                    summary->iterations.end());
  summary->iterations = std::move(iterations);
}

}  // namespace inceres::internal
