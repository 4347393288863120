#pragma once

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

/// Image points are normalized (plane z = 1) unless U says otherwise.
struct InverseDepthObservation {
  double anchor_point[2] = {0.0,
                            0.0};  ///< x_a, y_a: where the anchor sees the feature; taken as exact
  double observed_point[2] = {0.0, 0.0};         ///< z_b: where b sees it
  double sqrt_information[3] = {1.0, 0.0, 1.0};  ///< U = [u00 u01; 0 u11], see SqrtInformation
};

/// Reprojection of a feature that its anchor, the keyframe that saw it first, stores as a bearing
/// and an inverse depth; with analytic Jacobians. Slot 0 is the pose of the anchor a, slot 1 that
/// of the observing keyframe b ≠ a, slot 2 the inverse depth d (1, 1/m). Poses are [p(3), q(x, y,
/// z, w)] on PoseManifold (problem/manifolds.h): p the camera's center in the world, R = R(q)
/// world_from_camera, (δp, φ) ↦ (p + δp, R Exp(φ)). No other manifold on the poses will do:
/// Jacobians are written in its tangent.
///
///     h = R_bᵀ (R_a m_a + d (p_a − p_b)),   m_a = (x_a, y_a, 1)
///     residual = U (h_xy / h_z − z_b)        (2 rows, whitened)
///
/// h is d times the point in camera coordinates of b. It is smooth at d = 0, a point at infinity.
/// Fails to evaluate where h_z = 0 or a result is not finite; points behind the camera evaluate, as
/// in the model.
///
/// Cost: about 150 multiplications a factor with Jacobians, no transcendental function, nothing
/// allocated. Threads: as FactorFamily; Add is for one writer. Source: Civera, Davison & Montiel,
/// "Inverse depth parametrization for monocular SLAM", 2008; derived in
/// inverse_depth_reprojection.cc.
class INCERES_EXPORT InverseDepthReprojectionFamily final
    : public MeasuredFamily<InverseDepthObservation> {
 public:
  InverseDepthReprojectionFamily() : MeasuredFamily(2, {{7, 6}, {7, 6}, {1, 1}}) {}

  const char* Name() const override { return "inverse-depth reprojection"; }
  SlotSpace Space(int s) const override { return s < 2 ? SlotSpace::kPose : SlotSpace::kEuclidean; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
};

}  // namespace inceres
