#pragma once

#include <petscksp.h>

#include <cstdint>
#include <vector>

#include "distributed/block_shares.h"
#include "distributed/petsc_objects.h"
#include "distributed/reduced_system.h"

namespace inceres::internal {

/// S + Λ_c as a matrix of PETSc. Owners of rows sum the shares of all ranks (BlockShares), in the
/// order of the ranks, and set the blocks where they belong: nothing passes PETSc's stash of
/// entries that others own, whose sums would come in the order of messages.
class AssembledSystem {
 public:
  /// kUpper: as MPISBAIJ, for Cholesky; kWhole: as MPIAIJ, for preconditioners of all kinds.
  using Form = BlockShares::Form;

  /// Collective, as all calls. Throws AgreedFailure, on all ranks, if one cannot plan its shares.
  AssembledSystem(Form form, const ReducedSystem& system);

  /// Sets the entries, after an elimination and SetDamping.
  void Assemble();

  Mat matrix() const { return matrix_.get(); }
  std::int64_t Bytes() const;

 private:
  void Preallocate(Form form);
  void AddDamping(std::vector<double>* sums) const;

  const ReducedSystem& system_;
  BlockShares shares_;
  PetscOwned<Mat, MatDestroy> matrix_;
};

/// b and x of (S + Λ_c) x = b, for solvers of PETSc: of the frames owned here.
class KspVectors {
 public:
  /// Collective, as Solve.
  explicit KspVectors(const RankedParts& parts);

  KSPConvergedReason Solve(KSP ksp, const std::vector<double>& b);
  /// What the last Solve has found; *x has its size already.
  void CopySolution(std::vector<double>* x) const;

 private:
  PetscOwned<Vec, VecDestroy> b_;
  PetscOwned<Vec, VecDestroy> x_;
};

}  // namespace inceres::internal
