#include "common/linearize.h"

#include <cmath>

namespace sliding_window {
namespace {

void ApplyLoss(const ceres::LossFunction& loss, LinearizedFactor* factor) {
  const double s = factor->r.squaredNorm();
  double rho[3];
  loss.Evaluate(s, rho);
  const double sqrt_rho1 = std::sqrt(rho[1]);
  double alpha = 0.0;
  if (s > 0.0 && rho[2] > 0.0) {
    alpha = 1.0 - std::sqrt(1.0 + 2.0 * s * rho[2] / rho[1]);
  }
  for (RowMajorMatrix& J : factor->J) {
    if (alpha != 0.0) {
      J -= (alpha / s) * factor->r * (factor->r.transpose() * J);
    }
    J *= sqrt_rho1;
  }
  factor->r *= sqrt_rho1 / (1.0 - alpha);
}

}  // namespace

LinearizedFactor Linearize(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
                           const std::vector<const double*>& x) {
  LinearizedFactor factor;
  factor.r.resize(cost.num_residuals());
  std::vector<double*> jacobians;
  for (const int size : cost.parameter_block_sizes()) {
    factor.J.emplace_back(cost.num_residuals(), size);
  }
  for (RowMajorMatrix& J : factor.J) {
    jacobians.push_back(J.data());
  }
  if (!cost.Evaluate(x.data(), factor.r.data(), jacobians.data())) {
    return {};
  }
  if (loss != nullptr) {
    ApplyLoss(*loss, &factor);
  }
  return factor;
}

}  // namespace sliding_window
