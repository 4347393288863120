#pragma once

#include "factors/imu_math.h"
#include "inceres/factors/imu_preintegrator.h"

namespace inceres::internal {

/// Where the conventions put the parts of a residual, and the biases of a speed-bias variable
/// (velocity first).
struct ImuLayout {
  int rotation, position, velocity, gyr_bias, acc_bias;  // first row of each
  int gyr_column, acc_column;                            // first column of each bias, 3 or 6
};

ImuLayout LayoutOf(const ImuConventions& conventions);

/// e_there = C e_here, a permutation of parts whose rotation is turned by R: from (φ, v, p, b_g,
/// b_a) to the rows given.
Matrix<15, 15> PartMap(const ImuLayout& rows, const Matrix3& R);

/// The places of a state's tangent: pose (δp, φ), then the speed-bias.
ImuLayout StateLayoutOf(const ImuConventions& conventions);

}  // namespace inceres::internal
