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

/// Similarities as plain arrays, [p(3), q(x, y, z, w), s] as SimilarityManifold stores them: S
/// takes a point of its own frame to s R X + p. Nothing here may alias; all functions are pure and
/// allocate nothing.

/// c = a ∘ b: s_a s_b, R_a R_b, p_a + s_a R_a p_b; the quaternion is made of unit length again.
INCERES_EXPORT void ComposeSimilarities(const double a[8], const double b[8], double c[8]);
/// The way back: 1/s, Rᵀ, −Rᵀ p / s.
INCERES_EXPORT void InvertSimilarity(const double a[8], double inverse[8]);

/// How the error of a measured relative similarity is written. With S_E = S_m⁻¹ S_a⁻¹ S_b, its
/// parts R_E, t_E, s_E, r = Log R_E, λ = ln s_E and u = R_aᵀ (p_b − p_a)/s_a − p_m:
enum class SimilarityErrorConvention {
  /// [u; r; λ]: PoseErrorConvention::kGeodesic with a scale. The position's error is in a's axes
  /// and a's unit of length.
  kGeodesic,
  /// [V⁻¹ t_E; r; λ] with V = ∫₀¹ e^{λτ} Exp(τ r) dτ: the logarithm of Sim(3), the error of g2o's
  /// EdgeSim3 (which has rotation, position, scale in this order). The position's error is in the
  /// axes and the unit of the measured pose.
  kLogarithm,
};

/// "geodesic", "logarithm".
INCERES_EXPORT const char* ToString(SimilarityErrorConvention convention);

/// b seen from a, and how well it is known.
struct RelativeSimilarityMeasurement {
  double p_m[3] = {0.0, 0.0, 0.0};       ///< in a's axes and a's unit
  double q_m[4] = {0.0, 0.0, 0.0, 1.0};  ///< R_m as a unit quaternion x, y, z, w
  double s_m = 1.0;                      ///< > 0: b's unit, in a's
  double sqrt_information[49] = {};      ///< U, row-major, upper triangular, see SqrtInformation
};

/// A measured relative similarity of two poses with a scale, for the loop closures of maps from one
/// camera, whose unit of length drifts; with analytic Jacobians. Slots 0 and 1 are a and b:
/// [p(3), q(x, y, z, w), s] on SimilarityManifold (problem/manifolds.h), no other will do; p is
/// where the camera is in the world, R = R(q) world_from_camera, and s the length in the world of
/// one unit of the camera's own map.
///
///     residual = U [e_p; e_r; λ]                      (7 rows: lengths, radians, ln; whitened)
///
/// Smooth wherever the angle of R_E is below π; Jacobians are exact to about 1e-11, of kLogarithm
/// while |λ| < 200. Fails to evaluate where a scale is not positive or a result is not finite.
///
/// Cost: two 7×7 triangular products and one arc tangent a factor, of kLogarithm ten sines more;
/// nothing allocated. Threads: as FactorFamily; Add is for one writer. Source: Strasdat, Montiel &
/// Davison, "Scale drift-aware large scale monocular SLAM", RSS 2010; Sola, Deray & Atchuthan, "A
/// micro Lie theory for state estimation in robotics", 2018, appendix B.
class INCERES_EXPORT RelativeSimilarityFamily final
    : public MeasuredFamily<RelativeSimilarityMeasurement> {
 public:
  /// For errors of this convention.
  explicit RelativeSimilarityFamily(
      SimilarityErrorConvention convention = SimilarityErrorConvention::kGeodesic)
      : MeasuredFamily(7, {{8, 7}, {8, 7}}), convention_(convention) {}

  /// The convention of all its factors.
  SimilarityErrorConvention convention() const { return convention_; }

  const char* Name() const override { return "relative similarity"; }
  SlotSpace Space(int /*s*/) const override { return SlotSpace::kSimilarity; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  SimilarityErrorConvention convention_;
};

}  // namespace inceres
