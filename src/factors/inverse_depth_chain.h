#pragma once

#include <algorithm>

#include "factors/pose_slot.h"
#include "inceres/problem/rotation.h"

namespace inceres::internal {

inline double Dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// From a feature (m, λ) in camera i to λ times the point in camera j, over two poses of a body or
/// within one, by one camera or two; see BodyReprojectionFamily for the letters and the order of
/// the slots.
template <int poses, int cameras>
struct InverseDepthChain {
  static constexpr int kPoseI = poses == 2 ? 0 : -1;
  static constexpr int kPoseJ = poses == 2 ? 1 : -1;
  static constexpr int kCameraI = poses;
  static constexpr int kCameraJ = poses + cameras - 1;
  static constexpr int kFeature = poses + cameras;
  static constexpr int kTimeOffset = kFeature + 1;

  InverseDepthChain(const double* const* parameters, double m_x, double m_y, double inverse_depth)
      : x(parameters), m{m_x, m_y, 1.0}, lambda(inverse_depth) {
    QuaternionToMatrix(x[kCameraI] + 3, R_ci);
    QuaternionToMatrix(x[kCameraJ] + 3, R_cj);
    MultiplyMatrixVector(R_ci, m, b_i);
    for (int k = 0; k < 3; ++k) {
      b_i[k] += lambda * x[kCameraI][k];
    }
    if constexpr (poses == 2) {
      double world[3];
      QuaternionToMatrix(x[kPoseI] + 3, R_i);
      QuaternionToMatrix(x[kPoseJ] + 3, R_j);
      MultiplyMatrixVector(R_i, b_i, world);
      for (int k = 0; k < 3; ++k) {
        baseline[k] = x[kPoseI][k] - x[kPoseJ][k];
        world[k] += lambda * baseline[k];
      }
      MultiplyTransposed(R_j, world, b_j);
    } else {
      std::copy_n(b_i, 3, b_j);
    }
    double from_camera[3];
    for (int k = 0; k < 3; ++k) {
      from_camera[k] = b_j[k] - lambda * x[kCameraJ][k];
    }
    MultiplyTransposed(R_cj, from_camera, h);
  }

  const double* const* x;
  double m[3];
  double lambda;
  double R_i[9], R_j[9], R_ci[9], R_cj[9];
  double baseline[3];  // p_i − p_j
  double b_i[3];       // R_ci m + λ t_ci: λ times the point on the body at i
  double b_j[3];       // R_jᵀ (R_i b_i + λ (p_i − p_j)): on the body at j
  double h[3];         // R_cjᵀ (b_j − λ t_cj): in camera j
};

/// One row of each Jacobian from a = ∂residual_r/∂h, which goes back stage by stage: a_b = R_cj a
/// for b_j, a_w = R_j a_b for the world, a_i = R_iᵀ a_w for b_i, a_m = R_ciᵀ a_i for m. With right
/// perturbations R Exp(φ), where ∂(R v)/∂φ = −R[v]× and ∂(Rᵀv)/∂φ = [Rᵀv]×:
///     p_i: λ a_w = −p_j,   φ_i: b_i × a_i,   φ_j: a_b × b_j,
///     t_ci: λ a_i,   φ_ci: m × a_m,   t_cj: −λ a_b,   φ_cj: a × h,
///     m: a_m,   λ: a_i·t_ci + a_w·(p_i − p_j) − a_b·t_cj.
/// If camera i is camera j, its columns are the sums of the two.
template <int poses, int cameras>
class InverseDepthRow {
 public:
  using Chain = InverseDepthChain<poses, cameras>;

  InverseDepthRow(const Chain& chain, const double a[3]) : v_(chain), a_(a) {
    MultiplyMatrixVector(v_.R_cj, a, a_b_);
    if constexpr (poses == 2) {
      MultiplyMatrixVector(v_.R_j, a_b_, a_w_);
      MultiplyTransposed(v_.R_i, a_w_, a_i_);
    } else {
      std::copy_n(a_b_, 3, a_i_);
    }
    MultiplyTransposed(v_.R_ci, a_i_, a_m_);
  }

  /// The row of a pose or a camera.
  void WritePose(int slot, double* row) const {
    if (slot == Chain::kPoseI) {
      WritePose(1.0, a_w_, v_.b_i, a_i_, row);
    } else if (slot == Chain::kPoseJ) {
      WritePose(-1.0, a_w_, a_b_, v_.b_j, row);
    } else if (slot != Chain::kCameraJ) {
      WritePose(1.0, a_i_, v_.m, a_m_, row);
    } else {
      WritePose(-1.0, a_b_, a_, v_.h, row);
      if constexpr (cameras == 1) {
        double at_i[6];
        WritePose(1.0, a_i_, v_.m, a_m_, at_i);
        for (int k = 0; k < 6; ++k) {
          row[k] += at_i[k];
        }
      }
    }
  }

  /// The row of λ or, with a bearing, of (m_x, m_y, λ).
  void WriteFeature(bool has_bearing, double* row) const {
    if (has_bearing) {
      row[0] = a_m_[0];
      row[1] = a_m_[1];
    }
    const double by_lambda = Dot(a_i_, v_.x[Chain::kCameraI]) - Dot(a_b_, v_.x[Chain::kCameraJ]);
    row[has_bearing ? 2 : 0] = by_lambda + (poses == 2 ? Dot(a_w_, v_.baseline) : 0.0);
  }

  /// ∂residual_r/∂m.
  const double* by_m() const { return a_m_; }

 private:
  void WritePose(double sign, const double by_place[3], const double left[3], const double right[3],
                 double* row) const {
    Cross(left, right, row + 3);
    for (int k = 0; k < 3; ++k) {
      row[k] = sign * v_.lambda * by_place[k];
    }
  }

  const Chain& v_;
  const double* a_;
  double a_b_[3], a_w_[3] = {}, a_i_[3], a_m_[3];
};

}  // namespace inceres::internal
