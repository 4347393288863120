#include "inceres/solver/incremental_options.h"

#include "base/option_rules.h"

namespace inceres {

Status IncrementalOptions::Validate() const {
  Status status =
      internal::OptionRules("IncrementalOptions")
          .NotNegative("max_num_iterations", max_num_iterations)
          .Positive("max_solver_time_in_seconds", max_solver_time_in_seconds)
          .Positive("max_factor_evaluations", max_factor_evaluations)
          .NotNegative("function_tolerance", function_tolerance)
          .NotNegative("gradient_tolerance", gradient_tolerance)
          .NotNegative("parameter_tolerance", parameter_tolerance)
          .NotNegative("fixed_cost", fixed_cost)
          .NotNegative("min_relative_decrease", min_relative_decrease)
          // The three dampings are ordered: μ is clamped between the first two when an Update
          // begins, and may rise to the third.
          .Positive("min_damping", min_damping)
          .Require(initial_damping >= min_damping, "initial_damping", initial_damping,
                   ">= min_damping")
          .Require(claim_damping_share > 0.0 && claim_damping_share <= 1.0, "claim_damping_share",
                   claim_damping_share, "in (0, 1]")
          .Require(max_damping >= initial_damping, "max_damping", max_damping, ">= initial_damping")
          .NotNegative("batch_share", batch_share)
          .AtLeastOne("num_threads", num_threads)
          // kByGraph is negative and compared for equality: any other negative share is a mistake.
          .Require(relinearization_share >= 0.0 || relinearization_share == kByGraph,
                   "relinearization_share", relinearization_share, ">= 0 or kByGraph")
          .Positive("relinearization_step", relinearization_step)
          // At 1 a step might leave all of its gain undone.
          .Require(
              (truncation_share >= 0.0 && truncation_share < 1.0) || truncation_share == kByGraph,
              "truncation_share", truncation_share, "in [0, 1) or kByGraph")
          .NotNegative("max_landmark_refinements", max_landmark_refinements)
          .NotNegative("max_new_frame_steps", max_new_frame_steps)
          .status();
  if (!status.ok()) {
    return status;
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
