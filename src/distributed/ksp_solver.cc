// Whatever PETSc's options say.
#include <petscksp.h>

#include <memory>
#include <string>

#include "distributed/assembled_system.h"

// The solver for kKsp: PETSc's Krylov methods on (S + Λ_c) δ_c = b, with what options of prefix
// -inceres_ say. S is a shell around ReducedSystem::Multiply, or formed as AssembledSystem where
// conjugate_gradients.explicit_schur_complement asks for it. Unless told otherwise the
// preconditioner is a shell as well, around the blocks or the two levels of ReducedSystem.
//
// PETSc stops by a residual's norm relative to that of b, with eta as tolerance, and not by Ceres's
// rule for the decrease; so counts of iterations differ from those of kConjugateGradients.
//
// Callbacks are static functions with ReducedSystem as context. What they call is collective, and
// all ranks iterate together.

namespace inceres::internal {
namespace {

// Hands the entries of two vectors to what reads the one and writes the other.
// The arrays are those of this rank: entries of the frames it owns, without copies.
template <typename Apply>
PetscErrorCode OnArrays(Vec from, Vec to, const Apply& apply) {
  const double* in = nullptr;
  double* out = nullptr;
  PetscCall(VecGetArrayRead(from, &in));
  PetscCall(VecGetArrayWrite(to, &out));
  apply(in, out);
  PetscCall(VecRestoreArrayRead(from, &in));
  PetscCall(VecRestoreArrayWrite(to, &out));
  return 0;
}

class KspSolver final : public DistributedReducedSolver {
 public:
  KspSolver(const ConjugateGradientsOptions& options, ReducedSystem* system);

  const char* Name() const override { return name_.c_str(); }
  Status Solve(const std::vector<double>& b, std::vector<double>* x) override;
  int num_iterations() const override { return num_iterations_; }
  std::int64_t Bytes() const override { return matrix_ == nullptr ? 0 : matrix_->Bytes(); }

  /// By PETSc's options. kInvalidArgument: they ask for what they cannot have.
  Status MakeSolver();

 private:
  void MakeOperator();
  static PetscErrorCode MultiplyShell(Mat shell, Vec v, Vec y);
  static PetscErrorCode ApplyBlocks(PC shell, Vec r, Vec z);

  const ConjugateGradientsOptions options_;
  ReducedSystem& system_;
  std::unique_ptr<AssembledSystem> matrix_;  // null: S is a shell
  PetscOwned<Mat, MatDestroy> shell_;
  KspVectors vectors_;
  PetscOwned<KSP, KSPDestroy> ksp_;
  bool uses_blocks_ = false;
  int num_iterations_ = 0;
  std::string name_;
};

// Vectors have the entries owned here, in the order of ReducedSystem.
KspSolver::KspSolver(const ConjugateGradientsOptions& options, ReducedSystem* system)
    : options_(options), system_(*system), vectors_(system->parts()) {
  MakeOperator();
}

// The whole matrix, both triangles: preconditioners of all kinds take it.
void KspSolver::MakeOperator() {
  if (options_.explicit_schur_complement) {
    matrix_ = std::make_unique<AssembledSystem>(AssembledSystem::Form::kWhole, system_);
    return;
  }
  const SharedFrames& frames = system_.parts().frames;
  const PetscInt own = ToPetscInt(frames.owned_size(FramePlace::kTangent));
  const PetscInt all = ToPetscInt(frames.total_size(FramePlace::kTangent));
  Check(
      MatCreateShell(system_.parts().ranks.comm(), own, own, all, all, &system_, shell_.Receive()),
      "MatCreateShell");
  // As PETSc takes operations of any signature.
  using Function = void (*)();
  Check(MatShellSetOperation(shell_.get(), MATOP_MULT,
                             reinterpret_cast<Function>(&KspSolver::MultiplyShell)),
        "MatShellSetOperation");
  Check(MatSetOption(shell_.get(), MAT_SPD, PETSC_TRUE), "MatSetOption");
}

// Defaults first, then the options of the command line, then what came of them: the name in the
// summary says what is really used. No rank waits for another in here.
Status KspSolver::MakeSolver() {
  Check(KSPCreate(system_.parts().ranks.comm(), ksp_.Receive()), "KSPCreate");
  KSP ksp = ksp_.get();
  Mat S = matrix_ != nullptr ? matrix_->matrix() : shell_.get();
  Check(KSPSetOptionsPrefix(ksp, "inceres_"), "KSPSetOptionsPrefix");
  Check(KSPSetOperators(ksp, S, S), "KSPSetOperators");
  Check(KSPSetType(ksp, KSPCG), "KSPSetType");
  Check(KSPSetTolerances(ksp, options_.eta, PETSC_DEFAULT, PETSC_DEFAULT, options_.max_iterations),
        "KSPSetTolerances");
  PC pc = nullptr;
  Check(KSPGetPC(ksp, &pc), "KSPGetPC");
  Check(PCSetType(pc, PCSHELL), "PCSetType");
  Check(PCShellSetContext(pc, &system_), "PCShellSetContext");
  Check(PCShellSetApply(pc, &KspSolver::ApplyBlocks), "PCShellSetApply");
  Check(PCShellSetName(pc, "inceres blocks"), "PCShellSetName");
  Check(KSPSetFromOptions(ksp), "KSPSetFromOptions");
  const char* type = nullptr;
  Check(KSPGetType(ksp, &type), "KSPGetType");
  name_ = std::string("PETSc's ") + type + ", preconditioned by ";
  Check(PCGetType(pc, &type), "PCGetType");
  const std::string preconditioner = type != nullptr ? type : "nothing";
  // Only then Prepare is called in each solve.
  uses_blocks_ = preconditioner == PCSHELL;
  const bool two_level = options_.preconditioner == PreconditionerKind::kTwoLevel;
  name_ += !uses_blocks_ ? preconditioner : two_level ? "blocks, two-level" : "blocks";
  name_ += ", on the reduced system, ";
  name_ += matrix_ != nullptr ? "formed" : "by products";
  // A shell has no entries, so PETSc's own preconditioners could not be made; that is said by the
  // option's name before the first solve, instead of by an error of PETSc's in the middle of it.
  if (matrix_ != nullptr || uses_blocks_ || preconditioner == PCNONE) {
    return Status::Ok();
  }
  return Status::Error(StatusCode::kInvalidArgument,
                       "-inceres_pc_type " + preconditioner +
                           " needs the entries of S, which is not formed: ask for "
                           "explicit_schur_complement, or take shell or none");
}

// y = (S + Λ_c) v, a collective call within a collective call.
PetscErrorCode KspSolver::MultiplyShell(Mat shell, Vec v, Vec y) {
  ReducedSystem* system = nullptr;
  PetscCall(MatShellGetContext(shell, &system));
  return OnArrays(v, y, [&](const double* in, double* out) { system->Multiply(in, out); });
}

PetscErrorCode KspSolver::ApplyBlocks(PC shell, Vec r, Vec z) {
  ReducedSystem* system = nullptr;
  PetscCall(PCShellGetContext(shell, &system));
  return OnArrays(r, z, [&](const double* in, double* out) { system->Precondition(in, out); });
}

// A step that took too many iterations is as good as any. S and its preconditioner are made for
// each step, as each has another damping. What PETSc calls diverged is an error but for the limit
// of iterations, and reads kSingular, as of any step that cannot be solved for.
Status KspSolver::Solve(const std::vector<double>& b, std::vector<double>* x) {
  if (matrix_ != nullptr) {
    matrix_->Assemble();
    Check(KSPSetOperators(ksp_.get(), matrix_->matrix(), matrix_->matrix()), "KSPSetOperators");
  }
  if (uses_blocks_) {
    const Status status = system_.Prepare(options_.preconditioner);
    if (!status.ok()) {
      return status;
    }
  }
  const KSPConvergedReason reason = vectors_.Solve(ksp_.get(), b);
  PetscInt count = 0;
  Check(KSPGetIterationNumber(ksp_.get(), &count), "KSPGetIterationNumber");
  num_iterations_ = static_cast<int>(count);
  if (reason < 0 && reason != KSP_DIVERGED_ITS) {
    return Status::Error(StatusCode::kSingular, std::string("PETSc's solver did not converge: ") +
                                                    KSPConvergedReasons[reason]);
  }
  vectors_.CopySolution(x);
  return Status::Ok();
}

}  // namespace

std::unique_ptr<DistributedReducedSolver> MakeKspSolver(const ConjugateGradientsOptions& options,
                                                        ReducedSystem* system, Status* status) {
  // The operator is not made in the Try: the exchanges within would meet its agreement.
  auto solver = std::make_unique<KspSolver>(options, system);
  *status = system->parts().ranks.Try([&] { return solver->MakeSolver(); });
  return solver;
}

}  // namespace inceres::internal
