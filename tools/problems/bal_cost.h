#pragma once

#include <ceres/autodiff_cost_function.h>
#include <ceres/rotation.h>

#include "inceres/ceres/autodiff_cost_function.h"
#include "inceres/io/bal.h"

namespace inceres::tools {

/// Projects a point given in camera coordinates: p = −P.xy / P.z, (x, y) = f (1 + k1 |p|² + k2
/// |p|⁴) p with intrinsics [f k1 k2], and subtracts the observation. Pixels.
template <typename T>
void BalResidual(const T P[3], const T intrinsics[3], const double observed[2], T residuals[2]) {
  const T p_x = -P[0] / P[2];
  const T p_y = -P[1] / P[2];
  const T r2 = p_x * p_x + p_y * p_y;
  const T scale = intrinsics[0] * (1.0 + r2 * (intrinsics[1] + intrinsics[2] * r2));
  residuals[0] = scale * p_x - observed[0];
  residuals[1] = scale * p_y - observed[1];
}

/// Reprojection error of a BAL camera [angle-axis, t, f, k1, k2] (9) and a point (3): what users of
/// Ceres write for BAL files. Source: Snavely, Seitz & Szeliski, "Photo Tourism", 2006; Agarwal et
/// al., "Bundle Adjustment in the Large", 2010.
struct BalReprojectionError {
  double observed[2];

  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    T P[3];
    ceres::AngleAxisRotatePoint(camera, point, P);
    for (int k = 0; k < 3; ++k) {
      P[k] += camera[3 + k];
    }
    BalResidual(P, camera + 6, observed, residuals);
    return true;
  }

  /// With derivatives by ceres::AutoDiffCostFunction, or by another of its template arguments.
  template <template <typename, int, int...> class AutoDiff = ceres::AutoDiffCostFunction>
  static ceres::CostFunction* Create(const BalObservation& observation) {
    return new AutoDiff<BalReprojectionError, 2, 9, 3>(
        new BalReprojectionError{{observation.x, observation.y}});
  }
};

/// The same for a camera with a unit quaternion: [w x y z, t, f, k1, k2] (10), on Quaternion × R⁶.
struct BalQuaternionReprojectionError {
  double observed[2];

  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    T P[3];
    ceres::QuaternionRotatePoint(camera, point, P);
    for (int k = 0; k < 3; ++k) {
      P[k] += camera[4 + k];
    }
    BalResidual(P, camera + 7, observed, residuals);
    return true;
  }

  /// As BalReprojectionError.
  template <template <typename, int, int...> class AutoDiff = ceres::AutoDiffCostFunction>
  static ceres::CostFunction* Create(const BalObservation& observation) {
    return new AutoDiff<BalQuaternionReprojectionError, 2, 10, 3>(
        new BalQuaternionReprojectionError{{observation.x, observation.y}});
  }
};

}  // namespace inceres::tools
