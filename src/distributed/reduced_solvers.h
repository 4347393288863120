#pragma once

#include <memory>

#include "distributed/reduced_system.h"
#include "inceres/distributed/options.h"

namespace inceres::internal {

/// Makes the solver that the options ask for. `kind` is not kAutomatic. Collective; the Status is
/// the same on all ranks. `system` outlives it.
std::unique_ptr<DistributedReducedSolver> MakeDistributedSolver(
    DistributedLinearSolver kind, const ConjugateGradientsOptions& options, ReducedSystem* system,
    Status* status);

/// The three of them.
std::unique_ptr<DistributedReducedSolver> MakeMergedGradients(
    const ConjugateGradientsOptions& options, ReducedSystem* system);
std::unique_ptr<DistributedReducedSolver> MakeKspSolver(const ConjugateGradientsOptions& options,
                                                        ReducedSystem* system, Status* status);
std::unique_ptr<DistributedReducedSolver> MakeCholeskySolver(ReducedSystem* system, Status* status);

}  // namespace inceres::internal
