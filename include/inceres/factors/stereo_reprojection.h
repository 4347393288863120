#pragma once

#include "inceres/export.h"
#include "inceres/factors/point_observation.h"

namespace inceres {

/// Two rectified images: same intrinsics, no distortion, the right camera `baseline` along the left
/// one's x axis.
struct StereoCamera {
  double f_x = 1.0;       ///< focal length along x, pixels
  double f_y = 1.0;       ///< and along y
  double c_x = 0.0;       ///< principal point, pixels
  double c_y = 0.0;       ///< likewise
  double baseline = 0.1;  ///< meters
};

/// Where a stereo camera sees a landmark. Of a disparity d, right_u = left[0] − d.
struct StereoObservation {
  double left[2] = {0.0, 0.0};  ///< u_l, v: pixels
  double right_u = 0.0;         ///< u_r: pixels, in the same row
  double sqrt_information[9] = {
      1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0};  ///< U, row-major, upper triangular, see SqrtInformation
};

/// Reprojection of a landmark into a rectified stereo camera, with analytic Jacobians. Slots, h and
/// all else as PointObservationFamily has it; the camera of slot 1 is the left one.
///
///     residual = U [ f_x h_x / h_z + c_x − u_l;
///                    f_y h_y / h_z + c_y − v;
///                    f_x (h_x − ω baseline) / h_z + c_x − u_r ]
///
/// (3 rows, whitened). Fails to evaluate where h_z = 0 or a result is not finite.
class INCERES_EXPORT StereoReprojectionFamily final
    : public PointObservationFamily<StereoObservation> {
 public:
  /// For one stereo camera, and landmarks and poses of these kinds.
  explicit StereoReprojectionFamily(const StereoCamera& camera,
                                    LandmarkKind landmark = LandmarkKind::kPoint,
                                    Perturbation perturbation = Perturbation::kRight)
      : PointObservationFamily(3, landmark, perturbation), camera_(camera) {}

  /// The camera of all factors.
  const StereoCamera& camera() const { return camera_; }
  const char* Name() const override { return "stereo reprojection"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  StereoCamera camera_;
};

}  // namespace inceres
