#pragma once

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

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
/// [p(3), q(x, y, z, w), s] on SimilarityManifold (problem/similarity_manifold.h), no other will
/// do; p is where the camera is in the world, R = R(q) world_from_camera, and s the length in the
/// world of one unit of the camera's own map.
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
