// S factored by MUMPS.
#include <petscksp.h>

#include "distributed/assembled_system.h"
#include "distributed/reduced_solvers.h"

namespace inceres::internal {
namespace {

constexpr int kMumpsExtraSpace = 14;  // its ICNTL of that: per cent more than predicted
constexpr int kFirstExtraSpace = 50;
constexpr int kMaxExtraSpace = 1000;
constexpr int kMumpsSpaceTooSmall = -9;  // its INFOG(1)
constexpr int kMumpsSpaceTooSmallToo = -8;

class CholeskySolver final : public DistributedReducedSolver {
 public:
  explicit CholeskySolver(ReducedSystem* system) : matrix_(AssembledSystem::Form::kUpper, *system) {
    const MPI_Comm comm = system->ranks().comm();
    const SharedFrames& frames = system->frames();
    const PetscInt own = ToPetscInt(frames.owned_size(FramePlace::kTangent));
    const PetscInt all = ToPetscInt(frames.total_size(FramePlace::kTangent));
    Check(VecCreateMPI(comm, own, all, b_.Receive()), "VecCreateMPI");
    Check(VecDuplicate(b_.get(), x_.Receive()), "VecDuplicate");
    Check(KSPCreate(comm, ksp_.Receive()), "KSPCreate");
    Check(KSPSetOptionsPrefix(ksp_.get(), "inceres_direct_"), "KSPSetOptionsPrefix");
    Check(KSPSetType(ksp_.get(), KSPPREONLY), "KSPSetType");
  }

  const char* Name() const override { return "sparse Cholesky of MUMPS on the reduced system"; }

  Status Solve(const std::vector<double>& b, std::vector<double>* x) override {
    matrix_.Assemble();
    const LogStage stage("inceres factor S");
    Copy(b, b_.get());
    for (;; extra_space_ *= 2) {
      if (!is_set_up_) {
        SetUp();
      }
      Check(KSPSetOperators(ksp_.get(), matrix_.matrix(), matrix_.matrix()), "KSPSetOperators");
      Check(KSPSolve(ksp_.get(), b_.get(), x_.get()), "KSPSolve");
      KSPConvergedReason reason = KSP_CONVERGED_ITERATING;
      Check(KSPGetConvergedReason(ksp_.get(), &reason), "KSPGetConvergedReason");
      if (reason > 0) {
        break;
      }
      if (!IsSpaceTooSmall() || extra_space_ >= kMaxExtraSpace) {
        is_set_up_ = false;  // PETSc keeps a failed factor as failed
        return Status::Error(StatusCode::kSingular,
                             "the reduced system is not positive definite, MUMPS says");
      }
      is_set_up_ = false;
    }
    Copy(x_.get(), x);
    return Status::Ok();
  }

  std::int64_t Bytes() const override { return matrix_.Bytes(); }

 private:
  void SetUp() {
    PC pc = nullptr;
    Mat factor = nullptr;
    Check(KSPGetPC(ksp_.get(), &pc), "KSPGetPC");
    Check(PCReset(pc), "PCReset");
    Check(KSPSetOperators(ksp_.get(), matrix_.matrix(), matrix_.matrix()), "KSPSetOperators");
    Check(PCSetType(pc, PCCHOLESKY), "PCSetType");
    Check(PCFactorSetMatSolverType(pc, MATSOLVERMUMPS), "PCFactorSetMatSolverType");
    Check(PCFactorSetUpMatSolverType(pc), "PCFactorSetUpMatSolverType");
    Check(PCFactorGetMatrix(pc, &factor), "PCFactorGetMatrix");
    Check(MatMumpsSetIcntl(factor, kMumpsExtraSpace, extra_space_), "MatMumpsSetIcntl");
    Check(KSPSetFromOptions(ksp_.get()), "KSPSetFromOptions");
    is_set_up_ = true;
  }

  bool IsSpaceTooSmall() const {
    PC pc = nullptr;
    Mat factor = nullptr;
    PetscInt info = 0;
    Check(KSPGetPC(ksp_.get(), &pc), "KSPGetPC");
    Check(PCFactorGetMatrix(pc, &factor), "PCFactorGetMatrix");
    Check(MatMumpsGetInfog(factor, 1, &info), "MatMumpsGetInfog");
    return info == kMumpsSpaceTooSmall || info == kMumpsSpaceTooSmallToo;
  }

  AssembledSystem matrix_;
  PetscOwned<Vec, VecDestroy> b_;
  PetscOwned<Vec, VecDestroy> x_;
  PetscOwned<KSP, KSPDestroy> ksp_;
  int extra_space_ = kFirstExtraSpace;
  bool is_set_up_ = false;
};

}  // namespace

std::unique_ptr<DistributedReducedSolver> MakeCholeskySolver(ReducedSystem* system,
                                                             Status* status) {
  std::unique_ptr<DistributedReducedSolver> solver;
  *status = system->ranks().Try([&] {
    solver = std::make_unique<CholeskySolver>(system);
    return Status::Ok();
  });
  return solver;
}

}  // namespace inceres::internal
