#pragma once

#include <cmath>

#include "inceres/export.h"
#include "inceres/factors/point_reprojection.h"

namespace inceres {

/// A fisheye camera whose images grow with the angle θ from its axis: x right and y down in the
/// image, pixels from its upper left corner, z > 0 in front. A direction (x, y, z) of the camera's
/// frame, of any length, is seen at
///
///     ρ = ‖(x, y)‖,   θ = atan2(ρ, z),   d(θ) = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)
///     u = f_x d x / ρ + c_x,   v = f_y d y / ρ + c_y
///
/// so that directions beside and behind the image plane (θ ≥ 90°) have a place too; straight behind
/// (x = y = 0, z ≤ 0) has none. Source: Kannala & Brandt, "A generic camera model and calibration
/// method for conventional, wide-angle, and fish-eye lenses", 2006; the order of the coefficients
/// is that of OpenCV's fisheye module.
struct EquidistantCamera {
  double f_x = 1.0;  ///< focal length across, pixels per radian
  double f_y = 1.0;  ///< focal length down, pixels per radian
  double c_x = 0.0;  ///< principal point, pixels
  double c_y = 0.0;  ///< principal point, pixels
  double k1 = 0.0;   ///< of θ³
  double k2 = 0.0;   ///< of θ⁵
  double k3 = 0.0;   ///< of θ⁷
  double k4 = 0.0;   ///< of θ⁹

  /// (u, v) of a direction h. If J is not null it becomes ∂(u, v)/∂h, 2 × 3, row-major. Smooth on
  /// the axis; not finite straight behind. Pure, no allocation.
  void Project(const double h[3], double pixel[2], double* J = nullptr) const {
    const double rho2 = h[0] * h[0] + h[1] * h[1], norm2 = rho2 + h[2] * h[2];
    const double rho = std::sqrt(rho2);
    const double theta = std::atan2(rho, h[2]), t2 = theta * theta;
    const double polynomial = 1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)));
    // On the axis θ / ρ → 1 / z, and all below it is of second order in ρ / z.
    const bool on_axis = h[2] > 0.0 && rho2 < 1e-16 * norm2;
    const double scale = on_axis ? 1.0 / h[2] : theta * polynomial / rho;  // d / ρ
    pixel[0] = f_x * scale * h[0] + c_x;
    pixel[1] = f_y * scale * h[1] + c_y;
    if (J != nullptr) {
      // ∂θ/∂ρ = z / ‖h‖², ∂θ/∂z = −ρ / ‖h‖²
      const double slope =
          1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
      // (∂d/∂ρ − d / ρ) / ρ²
      const double bend = on_axis ? 0.0 : (slope * h[2] / norm2 - scale) / rho2;
      const double along = -slope / norm2;
      const double f[2] = {f_x, f_y};
      for (int r = 0; r < 2; ++r) {
        J[3 * r] = f[r] * bend * h[r] * h[0];
        J[3 * r + 1] = f[r] * bend * h[r] * h[1];
        J[3 * r + r] += f[r] * scale;
        J[3 * r + 2] = f[r] * along * h[r];
      }
    }
  }
};

/// Reprojection of a landmark into a fisheye camera, with analytic Jacobians. Slots, h and all else
/// as PointObservationFamily has it.
///
///     residual = U (camera(h) − z)                                             (2 rows, whitened)
///
/// Fails to evaluate straight behind the camera, in its center, or where a result is not finite. Of
/// a homogeneous landmark (X, ω) and −(X, ω) are seen in opposite directions. The camera is one for
/// the family; its intrinsics are not estimated.
class INCERES_EXPORT EquidistantReprojectionFamily final
    : public PointObservationFamily<PixelObservation> {
 public:
  /// The camera, what landmarks are, and on which side poses are perturbed.
  explicit EquidistantReprojectionFamily(const EquidistantCamera& camera,
                                         LandmarkKind landmark = LandmarkKind::kPoint,
                                         Perturbation perturbation = Perturbation::kRight)
      : PointObservationFamily(2, landmark, perturbation), camera_(camera) {}

  /// The camera of all factors.
  const EquidistantCamera& camera() const { return camera_; }
  const char* Name() const override { return "equidistant reprojection"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  EquidistantCamera camera_;
};

}  // namespace inceres
