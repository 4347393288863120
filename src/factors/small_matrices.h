#pragma once

#include <Eigen/Core>

#include "inceres/problem/rotation.h"

namespace inceres::internal {

/// Row-major, like the arrays of the public headers, which Eigen::Map then reads in place.
template <int rows, int columns>
using Matrix =
    Eigen::Matrix<double, rows, columns, columns == 1 ? Eigen::ColMajor : Eigen::RowMajor>;
using Matrix3 = Matrix<3, 3>;
using Vector3 = Matrix<3, 1>;

inline Eigen::Map<const Vector3> AsVector(const double v[3]) {
  return Eigen::Map<const Vector3>(v);
}

inline Matrix3 Skew(const Vector3& v) {
  Matrix3 M;
  M << 0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0;
  return M;
}

inline Matrix3 RotationOf(const double q[4]) {
  Matrix3 R;
  QuaternionToMatrix(q, R.data());
  return R;
}

}  // namespace inceres::internal
