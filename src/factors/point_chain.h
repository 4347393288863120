#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "factors/pose_slot.h"
#include "factors/whiten.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

namespace inceres::internal {

/// From a landmark in the world into a camera on a body; see PointObservationFamily for the
/// letters.
struct PointChain {
  static constexpr int kBody = 0, kCamera = 1, kLandmark = 2, kNumSlots = 3;

  PointChain(const double* const* parameters, int landmark_size)
      : p(parameters[kBody]),
        t_c(parameters[kCamera]),
        omega(landmark_size == 4 ? parameters[kLandmark][3] : 1.0) {
    const double* X = parameters[kLandmark];
    QuaternionToMatrix(p + 3, R);
    QuaternionToMatrix(t_c + 3, R_c);
    for (int k = 0; k < 3; ++k) {
      from_body[k] = X[k] - omega * p[k];
    }
    MultiplyTransposed(R, from_body, y);
    for (int k = 0; k < 3; ++k) {
      from_camera[k] = y[k] - omega * t_c[k];
    }
    MultiplyTransposed(R_c, from_camera, h);
  }

  const double* p;
  const double* t_c;
  double omega;
  double R[9], R_c[9];
  double from_body[3];    // X − ω p
  double y[3];            // Rᵀ (X − ω p): ω times the landmark on the body
  double from_camera[3];  // y − ω t_c
  double h[3];            // R_cᵀ (y − ω t_c): in the camera
};

/// One row of each Jacobian from a = ∂residual_r/∂h and a_omega = ∂residual_r/∂ω at fixed h. It
/// goes back stage by stage, a_y = R_c a for y and a_w = R a_y for the world:
///     p: −ω a_w,   t_c: −ω a_y,   X: a_w,   ω: a_omega − a_w·p − a_y·t_c.
/// A rotation turned by φ on the right gives ∂(Rᵀv)/∂φ = [Rᵀv]×, on the left Rᵀ[v]×:
///     φ: a_y × y,   φ_c: a × h              on the right,
///     φ: a_w × (X − ω p),   φ_c: a_y × (y − ω t_c)     on the left.
class PointRow {
 public:
  PointRow(const PointChain& chain, const double a[3]) : v_(chain), a_(a) {
    MultiplyMatrixVector(v_.R_c, a, a_y_);
    MultiplyMatrixVector(v_.R, a_y_, a_w_);
  }

  void WriteBody(bool left, double* row) const {
    WritePose(a_w_, left ? a_w_ : a_y_, left ? v_.from_body : v_.y, row);
  }
  void WriteCamera(bool left, double* row) const {
    WritePose(a_y_, left ? a_y_ : a_, left ? v_.from_camera : v_.h, row);
  }
  void WriteLandmark(double a_omega, int size, double* row) const {
    std::copy_n(a_w_, 3, row);
    if (size == 4) {
      row[3] = a_omega;
      for (int k = 0; k < 3; ++k) {
        row[3] -= a_w_[k] * v_.p[k] + a_y_[k] * v_.t_c[k];
      }
    }
  }

 private:
  void WritePose(const double by_place[3], const double left[3], const double right[3],
                 double* row) const {
    Cross(left, right, row + 3);
    for (int k = 0; k < 3; ++k) {
      row[k] = -v_.omega * by_place[k];
    }
  }

  const PointChain& v_;
  const double* a_;
  double a_y_[3], a_w_[3];
};

/// Writes the wanted Jacobians of factor i from A = ∂residual/∂(h, ω), whitened. Returns a sum over
/// what was written, which is finite only if all is.
template <int rows>
double WritePointJacobians(const FactorBatch& batch, int i, const PointChain& chain,
                           int landmark_size, bool left, const double A[rows][4]) {
  const std::ptrdiff_t first = PointChain::kNumSlots * static_cast<std::ptrdiff_t>(i);
  const TangentMap* const* maps = batch.tangent_maps + first;
  double by_landmark[rows * 4];
  double sum = 0.0;
  for (int r = 0; r < rows; ++r) {
    const PointRow writer(chain, A[r]);
    writer.WriteLandmark(A[r][3], landmark_size, by_landmark + r * landmark_size);
    for (int s = PointChain::kBody; s <= PointChain::kCamera; ++s) {
      if (!maps[s]->wanted()) {
        continue;
      }
      AssertPoseManifold(*maps[s], batch.parameters[first + s], left);
      double* row = batch.jacobians[s].data + i * batch.jacobians[s].factor_stride +
                    r * batch.jacobians[s].row_stride;
      if (s == PointChain::kBody) {
        writer.WriteBody(left, row);
      } else {
        writer.WriteCamera(left, row);
      }
      for (int k = 0; k < 6; ++k) {
        sum += row[k];
      }
    }
  }
  const TangentMap& map = *maps[PointChain::kLandmark];
  if (map.wanted()) {
    const JacobianView& view = batch.jacobians[PointChain::kLandmark];
    ProjectToTangentSpace(map, by_landmark, rows, view.data + i * view.factor_stride,
                          view.row_stride);
    for (int k = 0; k < rows * landmark_size; ++k) {
      sum += by_landmark[k];
    }
  }
  return sum;
}

/// Evaluates a batch of landmarks seen by `sensor`, which has
///     static constexpr int kRows;
///     void SqrtInformation(const Measurement&, double* U) const;  // row-major
///     void Error(const Measurement&, const double h[3], double omega, double* e,
///                double (*A)[4]) const;
///     const char* ReasonAt(const double h[3]) const;  // why a residual there is not finite
/// where A, if not null, becomes ∂e/∂(h, ω).
template <typename Family, typename Sensor>
EvaluationFailure EvaluatePoints(const Family& family, const FactorBatch& batch,
                                 const Sensor& sensor) {
  constexpr int kRows = Sensor::kRows;
  // 3 or 4, which tells whether landmarks are homogeneous.
  const int landmark_size = family.slot(PointChain::kLandmark).ambient_size;
  const bool left = family.perturbation() == Perturbation::kLeft;
  for (int i = batch.begin; i < batch.end; ++i) {
    const PointChain chain(
        batch.parameters + PointChain::kNumSlots * static_cast<std::ptrdiff_t>(i), landmark_size);
    double e[kRows], A[kRows][4], U[kRows * kRows];
    sensor.SqrtInformation(family.measurement(i), U);
    sensor.Error(family.measurement(i), chain.h, chain.omega, e,
                 batch.jacobians == nullptr ? nullptr : A);
    double* residual = batch.residuals + kRows * static_cast<std::ptrdiff_t>(i);
    if (!std::isfinite(MultiplyUpper<kRows, 1>(U, e, residual, 1))) {
      return {i, sensor.ReasonAt(chain.h)};
    }
    if (batch.jacobians == nullptr) {
      continue;
    }
    double whitened[kRows][4];
    MultiplyUpper<kRows, 4>(U, A[0], whitened[0], 4);
    if (!std::isfinite(
            WritePointJacobians<kRows>(batch, i, chain, landmark_size, left, whitened))) {
      return {i, "a Jacobian entry is not finite"};
    }
  }
  return {};
}

/// Why the residual of an image is not finite.
inline const char* ImageReason(const double h[3]) {
  return h[2] == 0.0 ? "the landmark lies in the camera's plane (depth 0)"
                     : "a residual is not finite";
}

}  // namespace inceres::internal
