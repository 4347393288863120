#pragma once

#include <Eigen/Core>
#include <ceres/sized_cost_function.h>

namespace sliding_window {

/// A landmark seen at xy: r = weight (c.xy / c.z - xy) with c = T_sc^-1 T_ws^-1 (x, y, z, w).
/// Parameter blocks: pose T_ws (7), landmark (4, homogeneous), extrinsic T_sc (7). Nearer than 0.2
/// m, or behind the camera, its derivatives are zero.
class ReprojectionError : public ceres::SizedCostFunction<2, 7, 4, 7> {
 public:
  ReprojectionError(const Eigen::Vector2d& xy, double weight) : xy_(xy), weight_(weight) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector2d xy_;
  double weight_;
};

}  // namespace sliding_window
