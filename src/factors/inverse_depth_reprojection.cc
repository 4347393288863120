#include <cmath>

#include "factors/pose_slot.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/problem/rotation.h"

// With anchor a and observer b: h = R_bᵀ R_a m_a + d R_bᵀ (p_a − p_b). The matrix R_bᵀ R_a and the
// baseline in b depend on the two poses only, and factors that share both follow one another in a
// family as a rule, so they are formed once and kept until the pair changes. Per feature that
// leaves a product of a 3×3 matrix with a vector. h is d times the point, smooth at d = 0 (Civera,
// Davison & Montiel 2008).

namespace inceres {
namespace {

using internal::MultiplyTransposed;

constexpr int kPositionColumn = 0;
constexpr int kRotationColumn = 3;

// What all features that keyframe b sees of anchor a share.
struct PosePair {
  const double* pose_a = nullptr;
  const double* pose_b = nullptr;
  double R_b[9] = {};
  double R_ba[9] = {};      // R_bᵀ R_a
  double baseline[3] = {};  // R_bᵀ (p_a − p_b)
};

// The values of one projection that both the residual and the Jacobians need.
struct Projection {
  double m_a[3];
  double h[3];  // d times the point in camera coordinates of b
  double inverse_h_z;
  double u[2];  // h_xy / h_z
};

// Neighbors in a family mostly share their pair.
// By address, and for one call: within it values do not change. A miss costs time only.
inline void Relate(const double* pose_a, const double* pose_b, PosePair& pair) {
  if (pose_a == pair.pose_a && pose_b == pair.pose_b) {
    return;
  }
  // Features of several anchors seen from the same b keep R_b.
  if (pose_b != pair.pose_b) {
    QuaternionToMatrix(pose_b + 3, pair.R_b);
  }
  pair.pose_a = pose_a;
  pair.pose_b = pose_b;
  double R_a[9];
  QuaternionToMatrix(pose_a + 3, R_a);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      pair.R_ba[3 * r + c] =
          pair.R_b[r] * R_a[c] + pair.R_b[3 + r] * R_a[3 + c] + pair.R_b[6 + r] * R_a[6 + c];
    }
  }
  const double difference[3] = {pose_a[0] - pose_b[0], pose_a[1] - pose_b[1],
                                pose_a[2] - pose_b[2]};
  MultiplyTransposed(pair.R_b, difference, pair.baseline);
}

// One division; a depth of zero makes it infinite, which Evaluate finds in the residuals.
inline void Project(const InverseDepthReprojectionFamily::Measurement& measurement,
                    const PosePair& pair, double d, Projection& v) {
  v.m_a[0] = measurement.anchor_point[0];
  v.m_a[1] = measurement.anchor_point[1];
  v.m_a[2] = 1.0;
  // m_z = 1, so the third column of the matrix is added as it is.
  for (int k = 0; k < 3; ++k) {
    const double* row = pair.R_ba + 3 * k;
    v.h[k] = row[0] * v.m_a[0] + row[1] * v.m_a[1] + row[2] + d * pair.baseline[k];
  }
  v.inverse_h_z = 1.0 / v.h[2];
  v.u[0] = v.h[0] * v.inverse_h_z;
  v.u[1] = v.h[1] * v.inverse_h_z;
}

// The rows a = ∂residual_r/∂h of U ∂(h_xy/h_z)/∂h, with ∂(h_xy/h_z)/∂h = [I | −u] / h_z.
// The whitening is in A already: one multiplication by U serves all slots.
inline void DifferentiateProjection(const Projection& v, const double U[3], double A[2][3]) {
  A[0][0] = v.inverse_h_z * U[0];
  A[0][1] = v.inverse_h_z * U[1];
  A[1][0] = 0.0;
  A[1][1] = v.inverse_h_z * U[2];
  for (int r = 0; r < 2; ++r) {
    A[r][2] = -(A[r][0] * v.u[0] + A[r][1] * v.u[1]);
  }
}

inline double* Row(const FactorBatch& batch, int i, int slot, int r) {
  const JacobianView& view = batch.jacobians[slot];
  return view.data + i * view.factor_stride + r * view.row_stride;
}

// One row of each Jacobian from a = ∂residual_r/∂h and w = R_b a = ∂residual_r/∂(point in the
// world, times d). With right perturbations R Exp(φ):
//     ∂h/∂p_a = d R_bᵀ = −∂h/∂p_b,   ∂h/∂d = R_bᵀ (p_a − p_b),
//     ∂h/∂φ_a = −R_bᵀ R_a [m_a]×  so  aᵀ ∂h/∂φ_a = (m_a × R_aᵀ R_b a)ᵀ,
//     ∂h/∂φ_b = [h]×              so  aᵀ ∂h/∂φ_b = (a × h)ᵀ.
// Returns a sum over what was written, which is finite only if all is.
inline double WriteRows(const FactorBatch& batch, int i, int r, const PosePair& pair,
                        const Projection& v, double d, const double a[3], const bool wanted[3]) {
  // All translations answer through w: both positions enter h as d R_bᵀ (p_a − p_b).
  double w[3];
  MultiplyMatrixVector(pair.R_b, a, w);
  double sum = 0.0;
  if (wanted[0]) {
    double* row = Row(batch, i, 0, r);
    double turned[3];
    MultiplyTransposed(pair.R_ba, a, turned);
    Cross(v.m_a, turned, row + kRotationColumn);
    for (int k = 0; k < 3; ++k) {
      row[kPositionColumn + k] = d * w[k];
      sum += row[kPositionColumn + k] + row[kRotationColumn + k];
    }
  }
  if (wanted[1]) {
    double* row = Row(batch, i, 1, r);
    Cross(a, v.h, row + kRotationColumn);
    for (int k = 0; k < 3; ++k) {
      row[kPositionColumn + k] = -d * w[k];
      sum += row[kPositionColumn + k] + row[kRotationColumn + k];
    }
  }
  if (wanted[2]) {
    double* row = Row(batch, i, 2, r);
    // How fast h moves along the baseline: zero without parallax, where d is not observable.
    row[0] = a[0] * pair.baseline[0] + a[1] * pair.baseline[1] + a[2] * pair.baseline[2];
    sum += row[0];
  }
  return sum;
}

double WriteJacobians(const FactorBatch& batch, int i, const PosePair& pair, const Projection& v,
                      double d, const double U[3]) {
  const std::ptrdiff_t first = 3 * static_cast<std::ptrdiff_t>(i);
  bool wanted[3];
  for (int s = 0; s < 3; ++s) {
    // wanted is the same for both rows, so it is asked for once.
    const TangentMap& map = *batch.tangent_maps[first + s];
    wanted[s] = map.wanted();
    if (s < 2 && wanted[s]) {
      internal::AssertPoseManifold(map, batch.parameters[first + s]);
    }
  }
  double A[2][3];
  DifferentiateProjection(v, U, A);
  return WriteRows(batch, i, 0, pair, v, d, A[0], wanted) +
         WriteRows(batch, i, 1, pair, v, d, A[1], wanted);
}

}  // namespace

EvaluationFailure InverseDepthReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  // Starts with null addresses, which no pose has.
  PosePair pair;
  for (int i = batch.begin; i < batch.end; ++i) {
    const Measurement& measurement = this->measurement(i);
    const double* const* parameters = batch.parameters + 3 * static_cast<std::ptrdiff_t>(i);
    const double d = parameters[2][0];
    // U = [u00 u01; 0 u11], in three entries.
    const double* U = measurement.sqrt_information;
    Projection v;
    Relate(parameters[0], parameters[1], pair);
    Project(measurement, pair, d, v);
    const double e[2] = {v.u[0] - measurement.observed_point[0],
                         v.u[1] - measurement.observed_point[1]};
    double* residual = batch.residuals + 2 * static_cast<std::ptrdiff_t>(i);
    residual[0] = U[0] * e[0] + U[1] * e[1];
    residual[1] = U[2] * e[1];
    if (!std::isfinite(residual[0] + residual[1])) {
      return {i, v.h[2] == 0.0 ? "the feature lies in the observing camera's plane (depth 0)"
                               : "a residual is not finite"};
    }
    if (batch.jacobians != nullptr && !std::isfinite(WriteJacobians(batch, i, pair, v, d, U))) {
      return {i, "a Jacobian entry is not finite"};
    }
  }
  return {};
}

}  // namespace inceres
