#pragma once

#include <vector>

#include <Eigen/Core>
#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

namespace sliding_window {

using RowMajorMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Residual and Jacobians (one per parameter block, ambient) of a cost function at x, with the loss
/// worked into them so that J^T J and J^T r are those of rho(|r|^2) / 2. Source: Triggs et al.,
/// Bundle Adjustment: A Modern Synthesis, section 4.3; the treatment of rho'' <= 0 is Ceres's.
struct LinearizedFactor {
  Eigen::VectorXd r;
  std::vector<RowMajorMatrix> J;
};

/// `loss` may be null. Empty r if the cost function cannot be evaluated.
LinearizedFactor Linearize(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
                           const std::vector<const double*>& x);

}  // namespace sliding_window
