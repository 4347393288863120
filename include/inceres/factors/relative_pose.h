#pragma once

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

/// The measured pose of b in a, and how well it is known.
struct RelativePoseMeasurement {
  double q_ab[4] = {0.0, 0.0, 0.0, 1.0};  ///< R_ab as a unit quaternion x, y, z, w
  double p_ab[3] = {0.0, 0.0, 0.0};       ///< meters
  double sqrt_information[36] = {};       ///< U, row-major, upper triangular, see SqrtInformation
};

/// A measured relative pose of two cameras, for example a loop closure; with analytic Jacobians.
/// Slots 0 and 1 are the poses a and b: [p(3), q(x, y, z, w)] on PoseManifold
/// (problem/manifolds.h), p the camera's center in the world, R = R(q) world_from_camera, (δp, φ) ↦
/// (p + δp, R Exp(φ)). No other manifold will do: Jacobians are written in its tangent.
///
///     residual = U [ Log(R_aᵀ R_b R_abᵀ) ; R_bᵀ (p_a − p_b) − p_ab ]
///
/// (6 rows: radians, then meters; whitened), so R_ab turns vectors of camera b into those of camera
/// a, and p_ab is a's center seen from b. Smooth wherever the rotation residual is below π. Fails
/// to evaluate where a result is not finite.
///
/// Cost: two 6×6 triangular products and one arc tangent a factor, nothing allocated. Threads: as
/// FactorFamily; Add is for one writer. Source: Sola, Deray & Atchuthan, "A micro Lie theory for
/// state estimation in robotics", 2018, appendix B.
class INCERES_EXPORT RelativePoseFamily final : public MeasuredFamily<RelativePoseMeasurement> {
 public:
  RelativePoseFamily() : MeasuredFamily(6, {{7, 6}, {7, 6}}) {}

  const char* Name() const override { return "relative pose"; }
  SlotSpace Space(int /*s*/) const override { return SlotSpace::kPose; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
};

}  // namespace inceres
