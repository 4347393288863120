#pragma once

#include <ceres/solver.h>

#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "inceres/solver/incremental_options.h"

namespace inceres::internal {

/// Reduced systems of up to so many unknowns are solved directly even if an iterative solver was asked for: were their factor
/// full, it would take 256 MiB.
inline constexpr int kMaxDirectSize = 8192;

/// What ITERATIVE_SCHUR and CGNR mean in incremental mode: preconditioned conjugate gradients, from the first step on, where the
/// reduced system has more than `max_direct_size` unknowns; below, nothing. Neither do they mean anything where `core` names a
/// solver itself. Cost: that of choosing landmarks, if there are that many unknowns.
void ChooseIterativeSolver(const ceres::Solver::Options& options, const ProblemView& view, const OrderingView& ordering,
                           int max_direct_size, IncrementalOptions* core);

}  // namespace inceres::internal
