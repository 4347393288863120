#pragma once

#include <memory>

#include "distributed/reduced_system.h"
#include "inceres/distributed/options.h"

namespace inceres::internal {

/// Makes the solver that the options ask for. `kind` is not kAutomatic. Collective; the Status is
/// the same on all ranks, and AgreedFailure is thrown on all. `system` outlives it.
std::unique_ptr<DistributedReducedSolver> MakeDistributedSolver(
    DistributedLinearSolver kind, const ConjugateGradientsOptions& options, ReducedSystem* system,
    Status* status);

/// The three of them.
std::unique_ptr<DistributedReducedSolver> MakeMergedGradients(
    const ConjugateGradientsOptions& options, ReducedSystem* system);
std::unique_ptr<DistributedReducedSolver> MakeKspSolver(const ConjugateGradientsOptions& options,
                                                        ReducedSystem* system, Status* status);
std::unique_ptr<DistributedReducedSolver> MakeCholeskySolver(ReducedSystem* system);

/// Why a factorization by MUMPS failed.
enum class MumpsFailure {
  kSpaceTooSmall,  ///< it has predicted too little, and is to be given more: ICNTL(14)
  kOutOfMemory,
  kOther,  ///< taken for one of the matrix
};
/// By its INFOG(1).
MumpsFailure MumpsFailureOf(int infog1);

}  // namespace inceres::internal
