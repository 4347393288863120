#pragma once

#include "inceres/solver/options.h"
#include "inceres/status.h"
#include "linear/conjugate_gradients.h"

namespace inceres::internal {

/// ζ_k = k (Q_k − Q_{k−1}) / Q_k < η for the quadratic model Q = xᵀAx/2 − bᵀx: whether Ceres's
/// solvers would stop here (Nash & Sofer 1990).
bool IsGoodEnoughForCeres(const ConjugateGradients& iteration, int min_iterations, double eta);

/// How a step's iterations have ended.
struct CgOutcome {
  int num_iterations = 0;
  bool converged = true;
};

/// From zero, as Ceres iterates: the residual is computed anew every ten iterations. A step that
/// took too many iterations, or met a direction without curvature, is as good as any; kSingular is
/// one that does not exist. Source: Ceres's conjugate_gradients_solver.cc.
Status IterateAsCeres(ConjugateGradients::System* system, int max_iterations, int min_iterations,
                      double eta, ConjugateGradients* iteration, CgOutcome* outcome);

}  // namespace inceres::internal
