#pragma once

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

/// An observed image point in pixels, origin at the image center, y upward.
struct BalReprojectionMeasurement {
  double x = 0.0;  ///< to the right, pixels
  double y = 0.0;  ///< up, pixels
};

/// Reprojection of a point X (3, world frame) into a camera of the "Bundle Adjustment in the Large"
/// model, with analytic Jacobians. Slot 0 is the camera [w(3), t(3), f, k1, k2]: rotation vector in
/// radians, translation, focal length in pixels, two radial distortion coefficients. Slot 1 is the
/// point.
///
///     P = Exp(w) X + t,   p = −P_xy / P_z,   r = ‖p‖
///     residual = f (1 + k1 r² + k2 r⁴) p − (x, y)        (2 rows, pixels)
///
/// The camera looks along −z. A factor fails to evaluate when P_z = 0 or a result is not finite;
/// points behind the camera (P_z > 0) evaluate, as in the model. The formulas are smooth at every
/// rotation, w = 0 and ‖w‖ = π included.
///
/// Cost: about 32 ns a factor with Jacobians, 7 ns without (x86-64, SSE2, 49 cameras); rotations
/// are computed once per camera and call where they can be. Allocates nothing in Evaluate. Threads:
/// as FactorFamily; Add is for one writer. Source: Agarwal, Snavely, Seitz & Szeliski, "Bundle
/// Adjustment in the Large", ECCV 2010, and the file format's page.
class INCERES_EXPORT BalReprojectionFamily final
    : public MeasuredFamily<BalReprojectionMeasurement> {
 public:
  /// Tangent sizes other than the defaults are for cameras or points on a manifold, for example a
  /// SubsetManifold that holds the intrinsics constant (tangent size 6).
  explicit BalReprojectionFamily(int camera_tangent_size = 9, int point_tangent_size = 3);

  const char* Name() const override { return "BAL reprojection"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
};

}  // namespace inceres
