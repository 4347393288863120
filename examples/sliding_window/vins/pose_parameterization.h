#pragma once

#include "common/pose.h"
#include "vins/local_parameterization.h"

namespace sliding_window {

/// p + dp and q dq(theta), dq = (theta / 2, 1) normalized. Its Jacobian is said to be [I; 0]: the
/// cost functions put their derivatives with respect to dp and theta into the first six columns of
/// the pose's Jacobian and leave the seventh zero.
class PoseParameterization : public LocalParameterization {
 public:
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool ComputeJacobian(const double* x, double* jacobian) const override;
  int GlobalSize() const override { return Pose::kSize; }
  int LocalSize() const override { return Pose::kTangentSize; }
};

}  // namespace sliding_window
