#include "tools/distributed/mpi_flags.h"

#include <gflags/gflags.h>

#include "tools/command_line/command_line.h"
#include "tools/solve/common_flags.h"

DEFINE_string(trust_region, "lm",
              "Trust-region strategy: lm (Levenberg-Marquardt), marquardt or dogleg.");
DEFINE_string(linear_solver, "auto",
              "Of the reduced system of the cameras: conjugate_gradients, cholesky (MUMPS), ksp "
              "(PETSc's, by -inceres_ksp_type and -inceres_pc_type), or auto: cholesky where its "
              "factor is predicted to be small, else conjugate_gradients.");
DEFINE_string(preconditioner, "schur_jacobi",
              "Of conjugate_gradients, and of ksp unless -inceres_pc_type says otherwise: "
              "identity, jacobi, schur_jacobi or two_level.");
DEFINE_bool(form_schur_complement, false,
            "With ksp: form the reduced system, for preconditioners that need its entries.");
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

Status ChooseKinds(MpiSettings* settings) {
  SolverOptions& solver = settings->options.solver;
  Status status = Choose("--trust_region", FLAGS_trust_region,
                         {{"lm", TrustRegionStrategyKind::kLevenbergMarquardt},
                          {"marquardt", TrustRegionStrategyKind::kMarquardt},
                          {"dogleg", TrustRegionStrategyKind::kDogleg}},
                         &solver.strategy);
  if (status.ok()) {
    status = Choose("--linear_solver", FLAGS_linear_solver,
                    {{"auto", DistributedLinearSolver::kAutomatic},
                     {"conjugate_gradients", DistributedLinearSolver::kConjugateGradients},
                     {"cholesky", DistributedLinearSolver::kCholesky},
                     {"ksp", DistributedLinearSolver::kKsp}},
                    &settings->options.linear_solver);
  }
  if (status.ok()) {
    status = Choose("--preconditioner", FLAGS_preconditioner,
                    {{"identity", PreconditionerKind::kIdentity},
                     {"jacobi", PreconditionerKind::kJacobi},
                     {"schur_jacobi", PreconditionerKind::kSchurJacobi},
                     {"two_level", PreconditionerKind::kTwoLevel}},
                    &solver.conjugate_gradients.preconditioner);
  }
  if (status.ok()) {
    status = Choose<std::string>("--partition", FLAGS_partition,
                                 {{"auto", "auto"}, {"order", "order"}, {"ptscotch", "ptscotch"}},
                                 &settings->partition);
  }
  return status;
}

}  // namespace

Status ReadMpiFlags(MpiSettings* settings) {
  CommonSettings common;
  Status status = ChooseKinds(settings);
  status = status.ok() ? ReadCommonFlags(&common) : status;
  if (!status.ok()) {
    return status;
  }
  settings->loss = MakeCoreLoss(common.robust);
  settings->robust = ToString(common.robust);
  DistributedOptions& options = settings->options;
  CopyNumbers(common, &options.solver);
  ConjugateGradientsOptions& gradients = options.solver.conjugate_gradients;
  gradients.explicit_schur_complement = FLAGS_form_schur_complement;
  gradients.eta = common.eta;
  gradients.max_iterations = common.max_linear_solver_iterations;
  options.checkpoint.path = FLAGS_checkpoint;
  options.checkpoint.every = FLAGS_checkpoint_every;
  options.checkpoint.resume = FLAGS_resume;
  return options.Validate();
}

}  // namespace inceres::tools
