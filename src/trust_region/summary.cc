#include "inceres/solver/summary.h"

#include "base/json_object.h"
#include "trust_region/summary_json.h"

namespace inceres {

using internal::JsonObject;

// Summaries as JSON (docs/json.md has the fields). The names are those of that page, and not
// always those of the members: num_inner_iterations counts steps of single landmarks.

namespace {

// A row of the trace. Of an iteration that was refused cost is that of the candidate, as in Ceres.
std::string ToJson(const IterationSummary& iteration) {
  return JsonObject()
      .Add("iteration", iteration.iteration)
      .Add("cost", iteration.cost)
      .Add("cost_change", iteration.cost_change)
      .Add("gradient_max_norm", iteration.gradient_max_norm)
      .Add("gradient_norm", iteration.gradient_norm)
      .Add("step_norm", iteration.step_norm)
      .Add("model_cost_change", iteration.model_cost_change)
      .Add("relative_decrease", iteration.relative_decrease)
      .Add("trust_region_radius", iteration.trust_region_radius)
      .Add("valid", iteration.step_is_valid)
      .Add("successful", iteration.step_is_successful)
      .Add("nonmonotonic", iteration.step_is_nonmonotonic)
      .Add("seconds", iteration.iteration_time_in_seconds)
      .Add("cumulative_seconds", iteration.cumulative_time_in_seconds)
      .Close();
}

}  // namespace

namespace internal {

// The stages of a solve, in the order in which they come in an iteration; total also has what is
// between them.
// Shared with other summaries, hence not in the unnamed namespace.
std::string ToJson(const StageSeconds& seconds) {
  return JsonObject()
      .Add("setup", seconds.setup)
      .Add("residuals", seconds.residuals)
      .Add("jacobians", seconds.jacobians)
      .Add("hessian", seconds.hessian)
      .Add("elimination", seconds.elimination)
      .Add("factorization", seconds.factorization)
      .Add("back_substitution", seconds.back_substitution)
      .Add("model_cost", seconds.model_cost)
      .Add("total", seconds.total)
      .Close();
}

std::string ToJson(const WorkCounts& work) {
  return JsonObject()
      .Add("num_residual_evaluations", work.num_residual_evaluations)
      .Add("num_jacobian_evaluations", work.num_jacobian_evaluations)
      .Add("num_linear_solves", work.num_linear_solves)
      .Add("num_conjugate_gradients", work.num_conjugate_gradients)
      .Add("num_steps_without_landmarks", work.num_steps_without_landmarks)
      .Add("num_inner_iterations", work.num_refined_landmarks)
      .Add("num_recentred_factors", work.num_recentered_factors)
      .Add("num_frames", work.num_frames)
      .Add("num_landmarks", work.num_landmarks)
      .Add("reduced_size", work.reduced_size)
      .Add("num_schur_products", work.num_schur_products)
      .Add("num_dynamic_size_factors", work.num_dynamic_size_factors)
      .Add("bytes", work.bytes)
      .Close();
}

}  // namespace internal

namespace {

// Values are doubles of the ambient space, dimensions degrees of freedom. Of the problem as it was
// given, and of what moves in it.
std::string ToJson(const ProblemSizes& sizes) {
  return JsonObject()
      .Add("num_variables", sizes.num_variables)
      .Add("num_values", sizes.num_values)
      .Add("num_moving_variables", sizes.num_moving_variables)
      .Add("num_moving_values", sizes.num_moving_values)
      .Add("num_dimensions", sizes.num_dimensions)
      .Add("num_factors", sizes.num_factors)
      .Add("num_residuals", sizes.num_residuals)
      .Close();
}

// All zeros without bounds. Only where variables have bounds does a step end in a line search.
std::string ToJson(const LineSearchSummary& search) {
  return JsonObject()
      .Add("num_steps", search.num_steps)
      .Add("cost_seconds", search.cost_seconds)
      .Add("gradient_seconds", search.gradient_seconds)
      .Add("polynomial_seconds", search.polynomial_seconds)
      .Add("total_seconds", search.total_seconds)
      .Close();
}

}  // namespace

// Ceres's names.
const char* ToString(Termination termination) {
  switch (termination) {
    case Termination::kConvergence:
      return "CONVERGENCE";
    case Termination::kNoConvergence:
      return "NO_CONVERGENCE";
    case Termination::kFailure:
      return "FAILURE";
    case Termination::kUserSuccess:
      return "USER_SUCCESS";
    case Termination::kUserFailure:
      return "USER_FAILURE";
  }
  // Of a number that is none of them.
  return "UNKNOWN";
}

// All fields are there whatever the solve came to. Numbers have 17 digits; null stands for what
// JSON has no number for. In the order of docs/json.md: how it ended, costs, steps, how it was
// solved, sizes, work, seconds and the trace. Flags are words of JSON, true and false.
std::string Summary::ToJson() const {
  return JsonObject()
      .AddString("termination", ToString(termination))
      .AddString("message", message)
      .AddString("detail", detail)
      .AddString("failed_step", failed_step)
      .Add("initial_cost", initial_cost)
      .Add("final_cost", final_cost)
      .Add("fixed_cost", fixed_cost)
      .Add("discarded_cost_change", discarded_cost_change)
      .Add("num_successful_steps", num_successful_steps)
      .Add("num_unsuccessful_steps", num_unsuccessful_steps)
      .Add("is_constrained", is_constrained)
      .AddRaw("line_search", inceres::ToJson(line_search))
      .Add("structure_reused", structure_reused)
      .Add("recomputed_jacobians", recomputed_jacobians)
      .AddString("reduced_solver", reduced_solver)
      .AddString("kernels", kernels)
      .AddString("strategy", strategy)
      .Add("num_threads", num_threads)
      .AddRaw("sizes", inceres::ToJson(sizes))
      .AddRaw("work", internal::ToJson(work))
      .AddRaw("seconds", internal::ToJson(seconds))
      .AddArray("iterations", iterations,
                [](const IterationSummary& iteration) { return inceres::ToJson(iteration); })
      .Close();
}

}  // namespace inceres
