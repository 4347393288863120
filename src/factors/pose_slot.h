#pragma once

#include <cassert>
#include <cstddef>

#include "factors/whiten.h"
#include "inceres/problem/factor_family.h"

namespace inceres::internal {

/// Asserts that a pose slot's tangent is PoseManifold's, the one the factors' formulas are written
/// in: δp first, added as it is, then q ⊗ Exp(φ), whose derivative at column φ_x is q_w / 2 in row
/// x and q_z / 2 in row y; -q_z / 2 with Exp(φ) ⊗ q, which is LeftPoseManifold's. Maps that merely
/// select columns are a wrapper's own doing.
inline void AssertPoseManifold(const TangentMap& map, const double* pose,
                               bool on_the_left = false) {
  assert(map.kind != TangentMap::Kind::kDense ||
         (map.plus_jacobian[0] == 1.0 && map.plus_jacobian[7] == 1.0 &&
          map.plus_jacobian[3 * 6 + 3] == 0.5 * pose[6] &&
          map.plus_jacobian[4 * 6 + 3] == (on_the_left ? -0.5 : 0.5) * pose[5]));
  static_cast<void>(map);
  static_cast<void>(pose);
  static_cast<void>(on_the_left);
}

/// Writes √Λ E of both poses of factor i, one that is wanted: jacobian_of(slot, E) fills E, zeros
/// before, with the error's derivative by the slot's tangent. Returns the sum of what was written,
/// which is finite only if all is.
template <typename JacobianOf>
double WritePosePair(const FactorBatch& batch, int i, const double* sqrt_information,
                     const JacobianOf& jacobian_of) {
  double sum = 0.0;
  for (int s = 0; s < 2; ++s) {
    const std::ptrdiff_t index = 2 * static_cast<std::ptrdiff_t>(i) + s;
    const TangentMap& map = *batch.tangent_maps[index];
    if (!map.wanted()) {
      continue;
    }
    AssertPoseManifold(map, batch.parameters[index]);
    double E[6][6] = {};
    jacobian_of(s, E);
    const JacobianView& view = batch.jacobians[s];
    sum += MultiplyUpper<6, 6>(sqrt_information, E[0], view.data + i * view.factor_stride,
                               view.row_stride);
  }
  return sum;
}

/// y = Mᵀ v for a row-major 3×3 matrix. y must not alias v.
inline void MultiplyTransposed(const double M[9], const double v[3], double y[3]) {
  for (int c = 0; c < 3; ++c) {
    y[c] = M[c] * v[0] + M[3 + c] * v[1] + M[6 + c] * v[2];
  }
}

}  // namespace inceres::internal
