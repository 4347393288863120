#pragma once

#include "common/frame.h"
#include "common/imu_preintegration.h"

namespace sliding_window {

/// What EvaluateImuResidual computes, before its weighting and as estimators in the field write it:
/// the products of quaternions as 4 x 4 matrices, every block of a 15 x 15 matrix filled in,
/// nothing shared between them.
struct FullImuResidual {
  ImuPreintegration::Vector15 e;         // unweighted
  ImuPreintegration::Matrix15 F_i, F_j;  // de by p, theta (q Exp(theta)), v, ba, bg of both states
};

/// F_i and F_j only if asked for.
FullImuResidual EvaluateInFull(const ImuPreintegration& imu, const ImuState& i, const ImuState& j,
                               bool with_jacobians);

/// W, lower triangular, with W^T W = covariance^-1: the Cholesky factor of the inverted covariance.
ImuPreintegration::Matrix15 SqrtInformationOf(const ImuPreintegration::Matrix15& covariance);

}  // namespace sliding_window
