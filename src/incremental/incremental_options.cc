#include "inceres/solver/incremental_options.h"

#include <sstream>

namespace inceres {

// The first culprit is named, in the order of the fields. Comparisons are written so that a NaN
// fails them.

Status IncrementalOptions::Validate() const {
  const auto fail = [](const char* field, double value, const char* rule) {
    std::ostringstream text;
    text << "IncrementalOptions::" << field << " = " << value << " but must be " << rule;
    return Status::Error(StatusCode::kInvalidArgument, text.str());
  };
  if (max_num_iterations < 0) {
    return fail("max_num_iterations", max_num_iterations, ">= 0");
  }
  if (!(max_solver_time_in_seconds > 0.0)) {
    return fail("max_solver_time_in_seconds", max_solver_time_in_seconds, "> 0");
  }
  if (max_factor_evaluations <= 0) {
    return fail("max_factor_evaluations", static_cast<double>(max_factor_evaluations), "> 0");
  }
  if (!(function_tolerance >= 0.0)) {
    return fail("function_tolerance", function_tolerance, ">= 0");
  }
  if (!(gradient_tolerance >= 0.0)) {
    return fail("gradient_tolerance", gradient_tolerance, ">= 0");
  }
  if (!(parameter_tolerance >= 0.0)) {
    return fail("parameter_tolerance", parameter_tolerance, ">= 0");
  }
  if (!(fixed_cost >= 0.0)) {
    return fail("fixed_cost", fixed_cost, ">= 0");
  }
  if (!(min_relative_decrease >= 0.0)) {
    return fail("min_relative_decrease", min_relative_decrease, ">= 0");
  }
  if (!(min_damping > 0.0)) {
    return fail("min_damping", min_damping, "> 0");
  }
  // The three dampings are ordered: μ is clamped between the first two when an Update begins, and
  // may rise to the third.
  if (!(initial_damping >= min_damping)) {
    return fail("initial_damping", initial_damping, ">= min_damping");
  }
  if (!(max_damping >= initial_damping)) {
    return fail("max_damping", max_damping, ">= initial_damping");
  }
  if (!(batch_share >= 0.0)) {
    return fail("batch_share", batch_share, ">= 0");
  }
  if (num_threads < 1) {
    return fail("num_threads", num_threads, ">= 1");
  }
  // kByGraph is negative and compared for equality: any other negative share is a mistake.
  if (!(relinearization_share >= 0.0 || relinearization_share == kByGraph)) {
    return fail("relinearization_share", relinearization_share, ">= 0 or kByGraph");
  }
  if (!(relinearization_step > 0.0)) {
    return fail("relinearization_step", relinearization_step, "> 0");
  }
  // At 1 a step might leave all of its gain undone.
  if (!((truncation_share >= 0.0 && truncation_share < 1.0) || truncation_share == kByGraph)) {
    return fail("truncation_share", truncation_share, "in [0, 1) or kByGraph");
  }
  if (max_landmark_refinements < 0) {
    return fail("max_landmark_refinements", max_landmark_refinements, ">= 0");
  }
  if (max_new_frame_steps < 0) {
    return fail("max_new_frame_steps", max_new_frame_steps, ">= 0");
  }
  // It chooses among the batch solver's ways; incremental mode has its own PCG, resumed factor and
  // Bayes tree.
  if (reduced_solver == ReducedSolverKind::kAutomaticInexact) {
    return Status::Error(
        StatusCode::kInvalidArgument,
        "IncrementalOptions::reduced_solver is kAutomaticInexact, which is for batch solves");
  }
  // Which of these go together is for the batch solver to say. The others are checked above, or set
  // by BatchOptions.
  SolverOptions batch;
  batch.strategy = batch_strategy;
  batch.linear_model = batch_linear_model;
  batch.reduced_solver = batch_reduced_solver;
  batch.conjugate_gradients = batch_conjugate_gradients;
  batch.max_memory_bytes = batch_max_memory_bytes;
  return batch.Validate();
}

}  // namespace inceres
