#include "tools/distributed/mpi_flags.h"

#include <utility>

#include <gflags/gflags.h>

#include "tools/command_line/command_line.h"
#include "tools/problems/loss_spec.h"

DEFINE_string(trust_region, "lm",
              "Trust-region strategy: lm (Levenberg-Marquardt), marquardt or dogleg.");
DEFINE_string(linear_solver, "auto",
              "Of the reduced system of the cameras: conjugate_gradients, cholesky (MUMPS), ksp "
              "(PETSc's, by -inceres_ksp_type and -inceres_pc_type), or auto: cholesky where its "
              "factor is predicted to be small, else conjugate_gradients.");
DEFINE_string(preconditioner, "schur_jacobi",
              "Of conjugate_gradients, and of ksp unless -inceres_pc_type says otherwise: "
              "identity, jacobi or schur_jacobi.");
DEFINE_bool(form_schur_complement, false,
            "With ksp: form the reduced system, for preconditioners that need its entries.");
DEFINE_double(eta, 0.1,
              "Conjugate gradients stop when iteration k gains less than this over k of what the "
              "step promises; of ksp the relative tolerance. At least 0.");
DEFINE_int32(max_linear_solver_iterations, 500, "Conjugate gradients a step at most, at least 1.");
DEFINE_int32(num_threads, 1, "Threads of each rank, at least 1.");
DEFINE_int32(max_num_iterations, 50, "Stop after this many iterations, at least 0.");
DEFINE_double(function_tolerance, 1e-6,
              "Stop when the cost changes by less than this, relative; 0: never.");
DEFINE_double(gradient_tolerance, 1e-10, "Stop when no entry of the gradient is larger; 0: never.");
DEFINE_double(parameter_tolerance, 1e-8,
              "Stop when the step is shorter than this, relative to the parameters; 0: never.");
DEFINE_double(initial_trust_region_radius, 1e4, "First trust-region radius. Above 0.");
DEFINE_string(robust, "none",
              "Robust loss: none, huber:A or cauchy:A, with the scale A in pixels.");
DEFINE_string(partition, "auto",
              "How points are dealt to ranks: by the order of the cameras in the file (order), by "
              "a partition of the camera graph (ptscotch), or auto: whichever has ranks share "
              "fewer cameras.");
DEFINE_string(checkpoint, "",
              "Write a checkpoint to this file, from which --resume goes on, every "
              "--checkpoint_every iterations.");
DEFINE_int32(checkpoint_every, 5, "Iterations from checkpoint to checkpoint, at least 1.");
DEFINE_string(resume, "", "Go on from this checkpoint, on any number of ranks.");

namespace inceres::tools {
namespace {

template <typename Kind>
Status Choose(const char* flag, const std::string& text,
              std::initializer_list<std::pair<const char*, Kind>> names, Kind* kind) {
  std::string known;
  for (const auto& [name, value] : names) {
    if (text == name) {
      *kind = value;
      return Status::Ok();
    }
    known += known.empty() ? name : std::string(", ") + name;
  }
  return Invalid("--" + std::string(flag) + " '" + text + "': use one of " + known);
}

Status ChooseKinds(MpiSettings* settings) {
  SolverOptions& solver = settings->options.solver;
  Status status = Choose("trust_region", FLAGS_trust_region,
                         {{"lm", TrustRegionStrategyKind::kLevenbergMarquardt},
                          {"marquardt", TrustRegionStrategyKind::kMarquardt},
                          {"dogleg", TrustRegionStrategyKind::kDogleg}},
                         &solver.strategy);
  if (status.ok()) {
    status = Choose("linear_solver", FLAGS_linear_solver,
                    {{"auto", DistributedLinearSolver::kAutomatic},
                     {"conjugate_gradients", DistributedLinearSolver::kConjugateGradients},
                     {"cholesky", DistributedLinearSolver::kCholesky},
                     {"ksp", DistributedLinearSolver::kKsp}},
                    &settings->options.linear_solver);
  }
  if (status.ok()) {
    status = Choose("preconditioner", FLAGS_preconditioner,
                    {{"identity", PreconditionerKind::kIdentity},
                     {"jacobi", PreconditionerKind::kJacobi},
                     {"schur_jacobi", PreconditionerKind::kSchurJacobi}},
                    &solver.conjugate_gradients.preconditioner);
  }
  if (status.ok()) {
    status = Choose<std::string>("partition", FLAGS_partition,
                                 {{"auto", "auto"}, {"order", "order"}, {"ptscotch", "ptscotch"}},
                                 &settings->partition);
  }
  return status;
}

}  // namespace

Status ReadMpiFlags(MpiSettings* settings) {
  Status status = ChooseKinds(settings);
  LossSpec loss;
  status = status.ok() ? ParseLoss(FLAGS_robust, &loss) : status;
  if (!status.ok()) {
    return Invalid(status.message);
  }
  settings->loss = MakeCoreLoss(loss);
  settings->robust = ToString(loss);
  DistributedOptions& options = settings->options;
  SolverOptions& solver = options.solver;
  solver.conjugate_gradients.explicit_schur_complement = FLAGS_form_schur_complement;
  solver.conjugate_gradients.eta = FLAGS_eta;
  solver.conjugate_gradients.max_iterations = FLAGS_max_linear_solver_iterations;
  solver.num_threads = FLAGS_num_threads;
  solver.max_num_iterations = FLAGS_max_num_iterations;
  solver.function_tolerance = FLAGS_function_tolerance;
  solver.gradient_tolerance = FLAGS_gradient_tolerance;
  solver.parameter_tolerance = FLAGS_parameter_tolerance;
  solver.initial_trust_region_radius = FLAGS_initial_trust_region_radius;
  options.checkpoint.path = FLAGS_checkpoint;
  options.checkpoint.every = FLAGS_checkpoint_every;
  options.checkpoint.resume = FLAGS_resume;
  return options.Validate();
}

}  // namespace inceres::tools
