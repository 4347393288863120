#pragma once

#include <cassert>

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

/// WriteFactor of an error e between poses, or of one: jacobian_of(slot, E) fills E, zeros before,
/// with the error's derivative by the slot's tangent.
template <typename JacobianOf>
const char* WritePoseFactor(const FactorBatch& batch, int i, int num_slots, const double* U,
                            const double* e, bool on_the_left, const JacobianOf& jacobian_of) {
  const auto write_slot = [&](int s, const TangentMap& map, const double* pose) {
    AssertPoseManifold(map, pose, on_the_left);
    double E[6][6] = {};
    jacobian_of(s, E);
    return WriteSlot<6, 6>(batch, i, s, U, E[0]);
  };
  return WriteFactor<6>(batch, i, num_slots, U, e, write_slot);
}

/// y = Mᵀ v for a row-major 3×3 matrix. y must not alias v.
inline void MultiplyTransposed(const double M[9], const double v[3], double y[3]) {
  for (int c = 0; c < 3; ++c) {
    y[c] = M[c] * v[0] + M[3 + c] * v[1] + M[6 + c] * v[2];
  }
}

}  // namespace inceres::internal
