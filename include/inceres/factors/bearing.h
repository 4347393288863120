#pragma once

#include "inceres/export.h"
#include "inceres/factors/point_observation.h"

namespace inceres {

/// In which direction a camera, of whatever model, sees a landmark.
struct BearingObservation {
  double direction[3] = {0.0, 0.0, 1.0};  ///< d, of any length but 0
  double sqrt_information[3] = {1.0, 0.0,
                                1.0};  ///< U = [u00 u01; 0 u11], 1/rad, see SqrtInformation
};

/// The bearing of a landmark on the unit sphere, with analytic Jacobians: for wide lenses. Slots, h
/// and all else as PointObservationFamily has it.
///
///     residual = U B h / ‖h‖                                                   (2 rows, whitened)
///
/// B (2×3) spans the plane across d, its rows near the image's x and y when d is near the axis: ‖B
/// h‖ / ‖h‖ is the sine of the angle between d and h, and 0 also when they are opposite. Of a
/// homogeneous landmark (X, ω) and −(X, ω) are seen in opposite directions. Fails to evaluate where
/// h = 0 or a result is not finite. Source: Qin, Li & Shen, "VINS-Mono", 2018, eq. 25, for a
/// landmark in the world.
class INCERES_EXPORT BearingFamily final : public PointObservationFamily<BearingObservation> {
 public:
  /// For landmarks and poses of these kinds.
  explicit BearingFamily(LandmarkKind landmark = LandmarkKind::kPoint,
                         Perturbation perturbation = Perturbation::kRight)
      : PointObservationFamily(2, landmark, perturbation) {}

  const char* Name() const override { return "bearing"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
};

}  // namespace inceres
