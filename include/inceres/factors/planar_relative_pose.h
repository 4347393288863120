#pragma once

#include "inceres/export.h"
#include "inceres/problem/ambient_family.h"

namespace inceres {

/// The measured motion from a to b, and how well it is known.
struct PlanarMotionMeasurement {
  double motion[3] = {0.0, 0.0, 0.0};  ///< p_m, θ_m: b seen from a
  double sqrt_information[9] = {
      1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0};  ///< U, row-major, upper triangular, see SqrtInformation
};

/// A measured relative pose of two planar poses a, b, each [x y θ], meters and radians, without a
/// manifold: angles may be any number of turns apart. With analytic Jacobians.
///
///     residual = U [ R(θ_a)ᵀ (p_b − p_a) − p_m ; wrap(θ_b − θ_a − θ_m) ]
///
/// (3 rows, whitened; wrap to [−π, π]).
///
/// Fails to evaluate where a result is not finite. Cost: two 3×3 triangular products and one angle
/// a factor, nothing allocated. Threads: as FactorFamily; Add is for one writer. Source: Grisetti
/// et al., "A tutorial on graph-based SLAM", 2010, section IV.
class INCERES_EXPORT PlanarRelativePoseFamily final
    : public MeasuredFamily<PlanarMotionMeasurement, AmbientFamily<PlanarRelativePoseFamily>> {
 public:
  PlanarRelativePoseFamily() : MeasuredFamily(3, {{3, 3}, {3, 3}}) {}

  const char* Name() const override { return "planar relative pose"; }

  /// For AmbientFamily.
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const;
};

}  // namespace inceres
