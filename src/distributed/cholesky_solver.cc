// S factored by MUMPS.
#include <petscksp.h>

#include <string>

#include "distributed/assembled_system.h"

// The solver for kCholesky: (S + Λ_c) δ_c = b with S formed in its upper triangle
// (AssembledSystem), factored in parallel by MUMPS through PETSc's preconditioner PCCHOLESKY, and
// one substitution (KSPPREONLY). Steps are exact up to rounding.
//
// The symbolic analysis is kept from step to step, since the pattern is; only a failure, or too
// little workspace, makes it anew. MUMPS predicts its workspace from the pattern, and pivots may
// need more: then the margin is doubled and the factorization tried again, with the larger margin
// kept for the steps after. All decisions come from numbers that MUMPS and KSP give to all ranks
// alike, so ranks stay together.

namespace inceres::internal {
namespace {

constexpr int kMumpsExtraSpace = 14;  // its ICNTL of that: per cent more than predicted
// In per cent, as MUMPS takes it; doubled as long as it is below the maximum.
constexpr int kFirstExtraSpace = 50;
constexpr int kMaxExtraSpace = 1000;
// For a matrix that is said to be positive definite (its SYM = 1) MUMPS takes negative pivots as
// they come, and counts them here: L D Lᵀ of an indefinite matrix is no error to it.
constexpr int kMumpsNegativePivots = 12;  // its INFOG of that

class CholeskySolver final : public DistributedReducedSolver {
 public:
  // Collective. A prefix of its own keeps -inceres_ksp_type, which is for kKsp, from changing this
  // solver, and lets MUMPS have options.
  explicit CholeskySolver(ReducedSystem* system)
      : matrix_(AssembledSystem::Form::kUpper, *system), vectors_(system->parts()) {
    Check(KSPCreate(system->parts().ranks.comm(), ksp_.Receive()), "KSPCreate");
    Check(KSPSetOptionsPrefix(ksp_.get(), "inceres_direct_"), "KSPSetOptionsPrefix");
    Check(KSPSetType(ksp_.get(), KSPPREONLY), "KSPSetType");
  }

  const char* Name() const override { return "sparse Cholesky of MUMPS on the reduced system"; }

  // Collective. Returns kSingular, which the loop answers with more damping, for failures of the
  // factorization but for too little workspace, and for that once the margin is at its maximum; and
  // kUnavailable, which ends the solve, where a rank is out of memory.
  Status Solve(const std::vector<double>& b, std::vector<double>* x) override {
    matrix_.Assemble();
    const LogStage stage("inceres factor S");
    // At most some tries: 50, 100, … until kMaxExtraSpace is reached.
    for (;; extra_space_ *= 2) {
      if (!is_set_up_) {
        SetUp();
      }
      Check(KSPSetOperators(ksp_.get(), matrix_.matrix(), matrix_.matrix()), "KSPSetOperators");
      if (vectors_.Solve(ksp_.get(), b) > 0) {
        break;
      }
      is_set_up_ = false;  // PETSc keeps a failed factor as failed
      // PETSc reports a failed factorization as a reason; MUMPS's own code says why.
      const PetscInt info = Infog(1);
      const MumpsFailure failure = MumpsFailureOf(static_cast<int>(info));
      if (failure == MumpsFailure::kOutOfMemory) {
        return Status::Error(StatusCode::kUnavailable,
                             "out of memory, MUMPS says: INFOG(1) = " + std::to_string(info));
      }
      if (failure != MumpsFailure::kSpaceTooSmall || extra_space_ >= kMaxExtraSpace) {
        return Indefinite();
      }
    }
    if (Infog(kMumpsNegativePivots) > 0) {
      return Indefinite();
    }
    vectors_.CopySolution(x);
    return Status::Ok();
  }

  std::int64_t Bytes() const override { return matrix_.Bytes(); }

 private:
  // Everything up to the numbers. The order is PETSc's: the package is chosen before the factor
  // matrix exists, and options of MUMPS can only be set on that matrix. PCReset drops what a failed
  // try has left.
  void SetUp() {
    PC pc = nullptr;
    Mat factor = nullptr;
    Check(KSPGetPC(ksp_.get(), &pc), "KSPGetPC");
    Check(PCReset(pc), "PCReset");
    // Tells PETSc that the values are new: it factors again, by the analysis there is.
    Check(KSPSetOperators(ksp_.get(), matrix_.matrix(), matrix_.matrix()), "KSPSetOperators");
    Check(PCSetType(pc, PCCHOLESKY), "PCSetType");
    Check(PCFactorSetMatSolverType(pc, MATSOLVERMUMPS), "PCFactorSetMatSolverType");
    Check(PCFactorSetUpMatSolverType(pc), "PCFactorSetUpMatSolverType");
    Check(PCFactorGetMatrix(pc, &factor), "PCFactorGetMatrix");
    Check(MatMumpsSetIcntl(factor, kMumpsExtraSpace, extra_space_), "MatMumpsSetIcntl");
    Check(KSPSetFromOptions(ksp_.get()), "KSPSetFromOptions");
    is_set_up_ = true;
  }

  static Status Indefinite() {
    return Status::Error(StatusCode::kSingular,
                         "the reduced system is not positive definite, MUMPS says");
  }

  // What MUMPS says of its last call. INFOG is global, unlike INFO: the same on all ranks.
  PetscInt Infog(int entry) const {
    PC pc = nullptr;
    Mat factor = nullptr;
    PetscInt value = 0;
    Check(KSPGetPC(ksp_.get(), &pc), "KSPGetPC");
    Check(PCFactorGetMatrix(pc, &factor), "PCFactorGetMatrix");
    Check(MatMumpsGetInfog(factor, entry, &value), "MatMumpsGetInfog");
    return value;
  }

  AssembledSystem matrix_;
  KspVectors vectors_;
  PetscOwned<KSP, KSPDestroy> ksp_;
  int extra_space_ = kFirstExtraSpace;
  bool is_set_up_ = false;
};

}  // namespace

// MUMPS's users' guide, "Error and warning diagnostics".
MumpsFailure MumpsFailureOf(int infog1) {
  switch (infog1) {
    case -8:   // integer workspace
    case -9:   // real workspace
    case -11:  // real workspace, for the solution
    case -14:  // integer workspace, for the solution
    case -15:  // integer workspace, for refinement
    case -17:  // the buffer that sends
    case -20:  // the buffer that receives
      return MumpsFailure::kSpaceTooSmall;
    case -5:   // real workspace of the analysis
    case -7:   // integer workspace of the analysis
    case -13:  // workspace of the factorization or the solution
    case -19:  // what ICNTL(23) allows, if anybody has set it
      return MumpsFailure::kOutOfMemory;
    default:
      return MumpsFailure::kOther;
  }
}

// Not in a Try: the exchanges within would meet its agreement. AssembledSystem agrees on what one
// rank alone can fail at.
std::unique_ptr<DistributedReducedSolver> MakeCholeskySolver(ReducedSystem* system) {
  return std::make_unique<CholeskySolver>(system);
}

}  // namespace inceres::internal
