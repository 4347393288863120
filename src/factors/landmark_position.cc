#include "inceres/factors/landmark_position.h"

#include <algorithm>
#include <cmath>

#include "factors/pose_slot.h"
#include "factors/small_matrices.h"
#include "factors/whiten.h"
#include "factors/wrap_angle.h"
#include "inceres/problem/rotation.h"

// Landmarks measured as positions in the axes of a pose, in the plane and in space, and positions
// of a pose measured in the world. The core of all is d = Rᵀ (l − p). With right perturbations R
// Exp(φ) it becomes d + [d]× φ, so the derivative by the rotation needs nothing but d itself; by l
// it is Rᵀ, by p −Rᵀ. In the plane the same with R(θ): ∂d/∂θ = (d_y, −d_x). All errors are whitened
// by an upper triangular U with UᵀU = information.

namespace inceres {
namespace {

using internal::AsVector;
using internal::Matrix;
using internal::Matrix3;
using internal::Skew;

// d = R(θ)ᵀ (l − p), and what it becomes by p, θ and l: rows x, y of five columns.
void SeePlanar(const double* pose, const double* landmark, double d[2], double D[10]) {
  // The same sine and cosine for d and its derivatives.
  const double c = std::cos(pose[2]), s = std::sin(pose[2]);
  const double dx = landmark[0] - pose[0], dy = landmark[1] - pose[1];
  d[0] = c * dx + s * dy;
  d[1] = c * dy - s * dx;
  // (∂d_x, ∂d_y) by p_x, p_y, θ, l_x, l_y.
  const double slopes[10] = {-c, -s, d[1], c, s, s, -c, -d[0], -s, c};
  std::copy_n(slopes, 10, D);
}

// Range and bearing in place of d; false where they are not defined.
// ρ = ‖d‖, β = atan2(d_y, d_x): dρ = d·∂d / ρ, dβ = (d_x ∂d_y − d_y ∂d_x) / ρ². D is replaced
// column by column, both rows at once, before d itself is.
bool ToRangeBearing(double d[2], double D[10]) {
  const double squared = d[0] * d[0] + d[1] * d[1];
  // Neither direction nor bearing is defined at zero; NaN fails as well.
  if (!(squared > 0.0)) {
    return false;
  }
  const double range = std::sqrt(squared);
  for (int k = 0; k < 5; ++k) {
    const double along = (d[0] * D[k] + d[1] * D[5 + k]) / range;
    const double across = (d[0] * D[5 + k] - d[1] * D[k]) / squared;
    D[k] = along;
    D[5 + k] = across;
  }
  const double bearing = std::atan2(d[1], d[0]);
  d[0] = range;
  d[1] = bearing;
  return true;
}

}  // namespace

bool PlanarLandmarkFamily::EvaluateOne(int i, const double* const* parameters, double* residuals,
                                       double** jacobians) const {
  const Measurement& m = measurement(i);
  const double* U = m.sqrt_information;
  double d[2], D[10];
  SeePlanar(parameters[0], parameters[1], d, D);
  // Of a position; with range and bearing it is replaced below.
  double e[2] = {d[0] - m.z[0], d[1] - m.z[1]};
  if (sighting_ == PlanarSighting::kRangeBearing) {
    if (!ToRangeBearing(d, D)) {
      return false;
    }
    e[0] = d[0] - m.z[0];
    // To [−π, π]: angles that differ by whole turns are the same bearing.
    e[1] = internal::WrapAngle(d[1] - m.z[1]);
  }
  residuals[0] = U[0] * e[0] + U[1] * e[1];
  residuals[1] = U[3] * e[1];
  // Five columns: three of the pose, two of the landmark. U is upper triangular, so row 1 has one
  // term.
  for (int k = 0; jacobians != nullptr && k < 5; ++k) {
    double* const J = jacobians[k < 3 ? 0 : 1];
    const int size = k < 3 ? 3 : 2, column = k < 3 ? k : k - 3;
    if (J != nullptr) {
      J[column] = U[0] * D[k] + U[1] * D[5 + k];
      J[size + column] = U[3] * D[5 + k];
    }
  }
  return true;
}

EvaluationFailure SpatialLandmarkFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluateEach(batch, [&](int i) {
    const Measurement& m = measurement(i);
    const double* const* parameters = batch.parameters + 2 * static_cast<std::ptrdiff_t>(i);
    const double *pose = parameters[0], *l = parameters[1];
    const double difference[3] = {l[0] - pose[0], l[1] - pose[1], l[2] - pose[2]};
    // y = Rᵀ (l − p): the landmark in the axes of the pose.
    const Matrix3 R = internal::RotationOf(pose + 3);
    double y[3];
    internal::MultiplyTransposed(R.data(), difference, y);
    const double e[3] = {y[0] - m.z[0], y[1] - m.z[1], y[2] - m.z[2]};
    const double* const U = m.sqrt_information;
    const auto write_slot = [&](int slot, const TangentMap& map, const double* /*values*/) {
      // ∂y/∂l = Rᵀ, ∂y/∂p = −Rᵀ, ∂y/∂φ = [y]×. The landmark is Euclidean: its columns are the
      // ambient ones.
      if (slot == 1) {
        const Matrix3 J = R.transpose();
        return internal::WriteSlot<3, 3>(batch, i, slot, U, J.data());
      }
      // The formulas hold in PoseManifold's tangent only; no other manifold will do.
      internal::AssertPoseManifold(map, pose);
      Matrix<3, 6> J;
      J << -R.transpose(), Skew(AsVector(y));
      return internal::WriteSlot<3, 6>(batch, i, slot, U, J.data());
    };
    return internal::WriteFactor<3>(batch, i, 2, U, e, write_slot);
  });
}

EvaluationFailure PositionPriorFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluateEach(batch, [&](int i) {
    const Measurement& m = measurement(i);
    const double* pose = batch.parameters[i];
    double arm[3];
    const Matrix3 R = internal::RotationOf(pose + 3);
    // The lever in the world's axes.
    MultiplyMatrixVector(R.data(), m.lever, arm);
    const double e[3] = {pose[0] + arm[0] - m.z[0], pose[1] + arm[1] - m.z[1],
                         pose[2] + arm[2] - m.z[2]};
    const double* const U = m.sqrt_information;
    const auto write_slot = [&](int slot, const TangentMap& map, const double* /*values*/) {
      internal::AssertPoseManifold(map, pose);
      // R Exp(φ) c ≈ R c − R [c]× φ.
      const Matrix3 cross = Skew(AsVector(m.lever));
      double J[18] = {};
      for (int r = 0; r < 3; ++r) {
        J[6 * r + r] = 1.0;
        for (int c = 0; c < 3; ++c) {
          for (int k = 0; k < 3; ++k) {
            J[6 * r + 3 + c] -= R(r, k) * cross(k, c);
          }
        }
      }
      return internal::WriteSlot<3, 6>(batch, i, slot, U, J);
    };
    return internal::WriteFactor<3>(batch, i, 1, U, e, write_slot);
  });
}

}  // namespace inceres
