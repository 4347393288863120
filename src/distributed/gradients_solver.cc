// The own conjugate gradients, and the choice among solvers.
#include "distributed/merged_gradients.h"
#include "distributed/reduced_solvers.h"

// S stays implicit here: each rank multiplies by its own C − Y Yᵀ, taken from the Jacobians, and
// the preconditioner is made anew for each step, since damping changes it. MakeDistributedSolver is
// the one place that turns an option into a solver.

namespace inceres::internal {
namespace {

class GradientsSolver final : public DistributedReducedSolver, private MergedGradients::System {
 public:
  // Does not fail: it owns no object of PETSc.
  GradientsSolver(const ConjugateGradientsOptions& options, ReducedSystem* system)
      : options_(options), system_(*system), iteration_(system->ranks()) {}

  const char* Name() const override {
    return options_.preconditioner == PreconditionerKind::kTwoLevel
               ? "conjugate gradients on the reduced system, by products, two-level"
               : "conjugate gradients on the reduced system, by products, one reduction an "
                 "iteration";
  }

  // A step that took too many iterations, or met a direction without curvature, is as good as any.
  Status Solve(const std::vector<double>& b, std::vector<double>* x) override {
    Status status = system_.Prepare(options_.preconditioner);
    if (!status.ok()) {
      return status;
    }
    // x starts from zero in each step, as Ceres's does.
    const MergedGradients::Limits limits{options_.eta, options_.min_iterations,
                                         options_.max_iterations};
    if (iteration_.Solve(limits, b, this, x) == MergedGradients::End::kBreakdown) {
      return Status::Error(StatusCode::kSingular,
                           "conjugate gradients: the residual or a curvature is zero or no number");
    }
    return Status::Ok();
  }

  int num_iterations() const override { return iteration_.num_iterations(); }

 private:
  void Multiply(const double* v, double* y) override { system_.Multiply(v, y); }
  void Precondition(const double* r, double* z) override { system_.Precondition(r, z); }

  const ConjugateGradientsOptions options_;
  ReducedSystem& system_;
  MergedGradients iteration_;
};

}  // namespace

std::unique_ptr<DistributedReducedSolver> MakeMergedGradients(
    const ConjugateGradientsOptions& options, ReducedSystem* system) {
  return std::make_unique<GradientsSolver>(options, system);
}

std::unique_ptr<DistributedReducedSolver> MakeDistributedSolver(
    DistributedLinearSolver kind, const ConjugateGradientsOptions& options, ReducedSystem* system,
    Status* status) {
  *status = Status::Ok();
  switch (kind) {
    case DistributedLinearSolver::kCholesky:
      return MakeCholeskySolver(system);
    case DistributedLinearSolver::kKsp:
      return MakeKspSolver(options, system, status);
    // Resolved before; only kConjugateGradients comes here.
    case DistributedLinearSolver::kAutomatic:
    case DistributedLinearSolver::kConjugateGradients:
      break;
  }
  return MakeMergedGradients(options, system);
}

}  // namespace inceres::internal
