#pragma once

#include <Eigen/Core>
#include <ceres/sized_cost_function.h>

namespace sliding_window {

/// A feature first seen in frame i at xy_i with inverse depth lambda, and seen again in frame j at
/// xy_j:
///
///     x = T_bc^-1 T_wj^-1 T_wi T_bc (xy_i, 1) / lambda,    r = weight (x.xy / x.z - xy_j)
///
/// Parameter blocks: pose i, pose j, extrinsic T_bc (7 each, see PoseParameterization), lambda (1).
class ProjectionFactor : public ceres::SizedCostFunction<2, 7, 7, 7, 1> {
 public:
  ProjectionFactor(const Eigen::Vector2d& xy_i, const Eigen::Vector2d& xy_j, double weight)
      : xy_i_(xy_i), xy_j_(xy_j), weight_(weight) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector2d xy_i_, xy_j_;
  double weight_;
};

}  // namespace sliding_window
