#pragma once

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

/// How the error of a measured relative pose is written. With E = R_mᵀ R_aᵀ R_b, r = Log E, ε the
/// vector of E's unit quaternion of w ≥ 0, and u = R_aᵀ (p_b − p_a) − p_m:
enum class PoseErrorConvention {
  kGeodesic,  ///< [u; r]: a distance on the group of rotations, what RelativePoseFamily measures
  /// [u; −2 R_m ε]: the example of pose graphs that comes with Ceres 2.1
  /// (pose_graph_3d_error_term.h)
  kCeres,
  kG2o,    ///< [R_mᵀ u; ε]: g2o's EdgeSE3 (isometry3d_mappings.h, toVectorMQT)
  kGtsam,  ///< [J_l⁻¹(r) R_mᵀ u; r]: GTSAM 4's BetweenFactor<Pose3>, Logmap of SE(3), reordered
};

/// "geodesic", "ceres", "g2o", "gtsam".
INCERES_EXPORT const char* ToString(PoseErrorConvention convention);

/// The measured pose of b in a, and how well it is known.
struct PoseEdgeMeasurement {
  double p_m[3] = {0.0, 0.0, 0.0};       ///< meters, in a's axes
  double q_m[4] = {0.0, 0.0, 0.0, 1.0};  ///< R_m as a unit quaternion x, y, z, w
  double sqrt_information[36] = {};      ///< U, row-major, upper triangular, see SqrtInformation
};

/// A measured relative pose of two spatial poses, in the error convention of the program that the
/// measurement and its information come from; with analytic Jacobians. Slots 0 and 1 are the poses
/// a and b: [p(3), q(x, y, z, w)] on PoseManifold (problem/manifolds.h), no other will do.
///
///     residual = U [e_p; e_r]        6 rows: meters, then radians or what the convention has there
///
/// All conventions agree to first order, but that g2o's rotation is half as long and g2o's and
/// GTSAM's position stands in the axes of the measured pose. Smooth wherever the angle of E is
/// below π; Jacobians are exact, J_r⁻¹ included, to about 1e-11. Fails to evaluate where a result
/// is not finite.
///
/// Cost: two 6×6 triangular products and one arc tangent a factor, nothing allocated. Threads: as
/// FactorFamily; Add is for one writer. Source: Sola, Deray & Atchuthan, "A micro Lie theory for
/// state estimation in robotics", 2018, appendices B and D; the programs named above.
class INCERES_EXPORT PoseEdgeFamily final : public MeasuredFamily<PoseEdgeMeasurement> {
 public:
  /// For errors of this convention.
  explicit PoseEdgeFamily(PoseErrorConvention convention = PoseErrorConvention::kGeodesic)
      : MeasuredFamily(6, {{7, 6}, {7, 6}}), convention_(convention) {}

  /// The convention of all its factors.
  PoseErrorConvention convention() const { return convention_; }

  const char* Name() const override { return "pose edge"; }
  SlotSpace Space(int /*s*/) const override { return SlotSpace::kPose; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  PoseErrorConvention convention_;
};

}  // namespace inceres
