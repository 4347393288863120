#pragma once

#include "inceres/export.h"
#include "inceres/problem/ambient_family.h"

namespace inceres {

/// How a camera or pose is stored, and with it where its center c is.
enum class CenterKind : unsigned char {
  kPose,        ///< [p(3), q(x, y, z, w)] of 6 degrees of freedom: c = p
  kBalCamera,   ///< [w(3), t(3), f, k1, k2], Euclidean, camera_from_world: c = −Exp(w)ᵀ t
  kPlanarPose,  ///< [x, y, θ]: c = (x, y, 0)
};

/// Writes the center of a camera or pose in the world. Pure.
INCERES_EXPORT void CenterOf(CenterKind kind, const double* values, double center[3]);

/// The distance, and how well it is known.
struct CenterDistanceMeasurement {
  double distance = 1.0;          ///< > 0, in the units of the world
  double sqrt_information = 1.0;  ///< 1 / standard deviation
};

/// A measured distance between the centers of two cameras or poses, with analytic Jacobians: a
/// baseline that is known, or what holds the scale of a problem that has none (factors/gauge.h).
///
///     residual = sqrt_information · (‖c_b − c_a‖ − distance)                       (1 row)
///
/// Poses may be on any manifold of tangent size 6. Fails to evaluate where the centers coincide or
/// a result is not finite. Cost: two rotations a factor at most, nothing allocated. Threads: as
/// FactorFamily; Add is for one writer.
class INCERES_EXPORT CenterDistanceFamily final
    : public MeasuredFamily<CenterDistanceMeasurement, AmbientFamily<CenterDistanceFamily>> {
 public:
  /// Between variables of this kind.
  explicit CenterDistanceFamily(CenterKind kind);

  /// Of both variables.
  CenterKind kind() const { return kind_; }

  const char* Name() const override { return "center distance"; }
  /// For AmbientFamily.
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const;

 private:
  CenterKind kind_;
};

}  // namespace inceres
