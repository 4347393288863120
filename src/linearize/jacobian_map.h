#pragma once

#include <cstddef>

#include <Eigen/Core>

#include "simd/kernels.h"

namespace inceres::internal {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using JacobianMap = Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>>;

/// J of one slot of a factor, where it is kept in doubles.
inline JacobianMap JacobianOf(const SlotJacobians& slot, std::ptrdiff_t factor, int num_rows) {
  return {slot.data + factor * slot.factor_stride, num_rows, slot.columns,
          Eigen::OuterStride<>(slot.row_stride)};
}

}  // namespace inceres::internal
