#pragma once

#include "inceres/export.h"
#include "inceres/factors/pinhole_camera.h"
#include "inceres/factors/point_observation.h"

namespace inceres {

/// Where a camera sees a landmark.
struct PixelObservation {
  double pixel[2] = {0.0, 0.0};                  ///< z, pixels
  double sqrt_information[3] = {1.0, 0.0, 1.0};  ///< U = [u00 u01; 0 u11], 1/pixel, see SqrtInformation
};

/// Reprojection of a landmark into a pinhole camera with radial-tangential distortion, with analytic Jacobians: what OKVIS
/// estimates. Slots, h and all else as PointObservationFamily has it.
///
///     residual = U (camera(h_xy / h_z) − z)                                    (2 rows, whitened)
///
/// Fails to evaluate where h_z = 0 or a result is not finite. The camera is one for the family; its intrinsics are not estimated
/// (BalReprojectionFamily does that).
class INCERES_EXPORT PointReprojectionFamily final : public PointObservationFamily<PixelObservation> {
 public:
  explicit PointReprojectionFamily(const PinholeCamera& camera, LandmarkKind landmark = LandmarkKind::kPoint,
                                   Perturbation perturbation = Perturbation::kRight)
      : PointObservationFamily(2, landmark, perturbation), camera_(camera) {}

  const char* Name() const override { return "point reprojection"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  PinholeCamera camera_;
};

}  // namespace inceres
