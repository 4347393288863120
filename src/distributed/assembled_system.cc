#include "distributed/assembled_system.h"

#include <algorithm>
#include <numeric>

namespace inceres::internal {

// S + Λ_c formed as a matrix of PETSc, for solvers that take entries. The matrix and its pattern
// are kept between calls; Assemble sums the shares of the ranks and inserts whole blocks.

AssembledSystem::AssembledSystem(Form form, const ReducedSystem& system)
    : system_(system),
      shares_(system.parts(), /*clusters=*/nullptr, form, BlockShares::Order::kByRank) {
  Preallocate(form);
}

// Gives PETSc the number of entries of each row, inside the square of columns owned here and
// outside, so that insertion never allocates.
void AssembledSystem::Preallocate(Form form) {
  const Communicator& ranks = system_.parts().ranks;
  const SharedFrames& frames = system_.parts().frames;
  const PetscInt rows = ToPetscInt(frames.owned_size(FramePlace::kTangent));
  const PetscInt all = ToPetscInt(frames.total_size(FramePlace::kTangent));
  const std::int64_t first = frames.owned_begin(FramePlace::kTangent);
  std::vector<PetscInt> inside(static_cast<std::size_t>(rows), 0);
  std::vector<PetscInt> outside(inside.size(), 0);
  for (const BlockShares::OwnedBlock& block : shares_.owned()) {
    const bool own_column = block.place.column >= first && block.place.column < first + rows;
    for (int r = 0; r < block.place.rows; ++r) {
      const auto row = static_cast<std::size_t>(block.place.row - first + r);
      // Of a diagonal block the upper form keeps columns r and behind.
      const bool half = form == Form::kUpper && block.place.row == block.place.column;
      (own_column ? inside : outside)[row] += block.place.columns - (half ? r : 0);
    }
  }
  Check(MatCreate(ranks.comm(), matrix_.Receive()), "MatCreate");
  Mat S = matrix_.get();
  Check(MatSetSizes(S, rows, rows, all, all), "MatSetSizes");
  if (form == Form::kUpper) {
    // Blocks of size 1, for frames differ in size. Of the two calls that follow the one of the
    // other type has no effect: on one rank the matrix is sequential.
    Check(MatSetType(S, MATSBAIJ), "MatSetType");
    Check(MatSeqSBAIJSetPreallocation(S, 1, 0, inside.data()), "MatSeqSBAIJSetPreallocation");
    Check(MatMPISBAIJSetPreallocation(S, 1, 0, inside.data(), 0, outside.data()),
          "MatMPISBAIJSetPreallocation");
    // Diagonal blocks are inserted as whole squares.
    Check(MatSetOption(S, MAT_IGNORE_LOWER_TRIANGULAR, PETSC_TRUE), "MatSetOption");
  } else {
    Check(MatSetType(S, MATAIJ), "MatSetType");
    Check(MatSeqAIJSetPreallocation(S, 0, inside.data()), "MatSeqAIJSetPreallocation");
    Check(MatMPIAIJSetPreallocation(S, 0, inside.data(), 0, outside.data()),
          "MatMPIAIJSetPreallocation");
  }
  Check(MatSetOption(S, MAT_SPD, PETSC_TRUE), "MatSetOption");
  // Assembly needs no messages: owners insert their own rows only.
  Check(MatSetOption(S, MAT_NO_OFF_PROC_ENTRIES, PETSC_TRUE), "MatSetOption");
}

// Λ_c goes in after the sums, once a frame, and not once a rank.
void AssembledSystem::AddDamping(std::vector<double>* sums) const {
  const std::vector<double>& damping = system_.owned_damping();
  std::size_t next = 0;  // diagonal blocks come in the order of the owned frames
  for (const BlockShares::OwnedBlock& block : shares_.owned()) {
    if (block.place.row != block.place.column) {
      continue;
    }
    // The diagonal of a row-major square is columns + 1 apart.
    for (int r = 0; r < block.place.rows; ++r) {
      (*sums)[static_cast<std::size_t>(block.begin + r * (block.place.columns + 1))] +=
          damping[next++];
    }
  }
}

// Collective. Reads the S of the last elimination and the damping of the last SetDamping.
void AssembledSystem::Assemble() {
  const LogStage stage("inceres assemble S");
  std::vector<double>& sums = shares_.Sum();
  AddDamping(&sums);
  // INSERT_VALUES replaces what the last assembly has left; every block of the pattern is written,
  // so nothing old remains.
  std::vector<PetscInt> rows;
  std::vector<PetscInt> columns;
  for (const BlockShares::OwnedBlock& block : shares_.owned()) {
    rows.resize(static_cast<std::size_t>(block.place.rows));
    columns.resize(static_cast<std::size_t>(block.place.columns));
    std::iota(rows.begin(), rows.end(), static_cast<PetscInt>(block.place.row));
    std::iota(columns.begin(), columns.end(), static_cast<PetscInt>(block.place.column));
    Check(MatSetValues(matrix_.get(), block.place.rows, rows.data(), block.place.columns,
                       columns.data(), sums.data() + block.begin, INSERT_VALUES),
          "MatSetValues");
  }
  Check(MatAssemblyBegin(matrix_.get(), MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  Check(MatAssemblyEnd(matrix_.get(), MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
}

std::int64_t AssembledSystem::Bytes() const {
  // of a value in the matrix, its column too
  return shares_.Bytes() +
         shares_.num_values() * static_cast<std::int64_t>(sizeof(double) + sizeof(PetscInt));
}

KspVectors::KspVectors(const RankedParts& parts) {
  const SharedFrames& frames = parts.frames;
  Check(VecCreateMPI(parts.ranks.comm(), ToPetscInt(frames.owned_size(FramePlace::kTangent)),
                     ToPetscInt(frames.total_size(FramePlace::kTangent)), b_.Receive()),
        "VecCreateMPI");
  Check(VecDuplicate(b_.get(), x_.Receive()), "VecDuplicate");
}

// Write access alone: PETSc need not fetch what is overwritten. The state of the vector changes
// when the array is restored.
KSPConvergedReason KspVectors::Solve(KSP ksp, const std::vector<double>& b) {
  double* values = nullptr;
  Check(VecGetArrayWrite(b_.get(), &values), "VecGetArrayWrite");
  std::copy(b.begin(), b.end(), values);
  Check(VecRestoreArrayWrite(b_.get(), &values), "VecRestoreArrayWrite");
  Check(KSPSolve(ksp, b_.get(), x_.get()), "KSPSolve");
  KSPConvergedReason reason = KSP_CONVERGED_ITERATING;
  Check(KSPGetConvergedReason(ksp, &reason), "KSPGetConvergedReason");
  return reason;
}

void KspVectors::CopySolution(std::vector<double>* x) const {
  const double* values = nullptr;
  Check(VecGetArrayRead(x_.get(), &values), "VecGetArrayRead");
  std::copy(values, values + x->size(), x->begin());
  Check(VecRestoreArrayRead(x_.get(), &values), "VecRestoreArrayRead");
}

}  // namespace inceres::internal
