#pragma once

#include <cmath>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/manifolds.h"

namespace inceres {

/// How a landmark in the world is stored.
enum class LandmarkKind : unsigned char {
  kPoint,  ///< X (3), meters; ω = 1
  /// (X, ω) (4), the point X / ω; ω = 0 is a direction. Tangent size 3: SphereManifold(4), which
  /// can reach infinity, or SubsetManifold(4, {3}), which holds ω as OKVIS's HomogeneousPoint does.
  /// With ω > 0, X points away from the world's origin.
  kHomogeneous,
};

/// What the families of a landmark seen by a camera on a body have in common. Slot 0 is the pose
/// (p, R) of the body in the world, slot 1 the camera on it, body_from_camera (t_c, R_c), slot 2
/// the landmark (X, ω). Poses are [p(3), q(x, y, z, w)] on PoseManifold (kRight) or
/// LeftPoseManifold (kLeft), both slots alike; no other manifold will do. The landmark may be on
/// any manifold of its tangent size.
///
///     h = R_cᵀ (Rᵀ (X − ω p) − ω t_c)                ω times the landmark in the camera
///
/// All residuals are functions of h / ω, or of the direction of h, so that points at infinity are
/// points like others. Points behind the camera evaluate, as in the model.
///
/// Cost: about 200 multiplications a factor with Jacobians, no transcendental function, nothing
/// allocated. Threads: as FactorFamily; Add is for one writer. Source: Leutenegger et al.,
/// "Keyframe-based visual-inertial odometry using nonlinear optimization", 2015, section 3.2;
/// derived in point_chain.h.
template <typename M>
class PointObservationFamily : public MeasuredFamily<M> {
 public:
  /// What the landmarks are.
  LandmarkKind landmark() const {
    return this->slot(2).ambient_size == 3 ? LandmarkKind::kPoint : LandmarkKind::kHomogeneous;
  }
  /// On which side poses are perturbed.
  Perturbation perturbation() const { return perturbation_; }

  /// Of poses; the landmark's Jacobian is projected.
  SlotSpace Space(int s) const override {
    if (s == 2) {
      return SlotSpace::kAny;
    }
    return perturbation_ == Perturbation::kLeft ? SlotSpace::kLeftPose : SlotSpace::kPose;
  }

 protected:
  /// For landmarks and poses of these kinds.
  PointObservationFamily(int residual_size, LandmarkKind landmark, Perturbation perturbation)
      : MeasuredFamily<M>(residual_size,
                          {{7, 6}, {7, 6}, {landmark == LandmarkKind::kPoint ? 3 : 4, 3}}),
        perturbation_(perturbation) {}

 private:
  Perturbation perturbation_;
};

/// A pinhole camera with radial-tangential distortion: z > 0 is in front, x right and y down in the
/// image, pixels from its upper left corner. A point (x, y, z) of the camera's frame is seen at
///
///     (a, b) = (x, y) / z,   r² = a² + b²,   s = 1 + k1 r² + k2 r⁴
///     u = f_x (s a + 2 p1 a b + p2 (r² + 2a²)) + c_x
///     v = f_y (s b + p1 (r² + 2b²) + 2 p2 a b) + c_y
///
/// Source: Brown, "Decentering distortion of lenses", 1966; the order of the coefficients is that
/// of OpenCV.
struct PinholeCamera {
  double f_x = 1.0;  ///< focal length along x, pixels
  double f_y = 1.0;  ///< and along y
  double c_x = 0.0;  ///< principal point, pixels
  double c_y = 0.0;  ///< likewise
  double k1 = 0.0;   ///< radial distortion, of r²
  double k2 = 0.0;   ///< and of r⁴
  double p1 = 0.0;   ///< tangential distortion
  double p2 = 0.0;   ///< likewise

  /// (u, v) of a point (a, b) of the plane z = 1. If J is not null it becomes ∂(u, v)/∂(a, b),
  /// row-major. Pure, no allocation.
  void Project(double a, double b, double pixel[2], double* J = nullptr) const {
    const double r2 = a * a + b * b;
    const double s = 1.0 + r2 * (k1 + r2 * k2);
    pixel[0] = f_x * (s * a + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)) + c_x;
    pixel[1] = f_y * (s * b + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b) + c_y;
    if (J != nullptr) {
      const double t = 2.0 * (k1 + 2.0 * k2 * r2);  // ∂s/∂a = a t, ∂s/∂b = b t
      const double mixed = a * b * t + 2.0 * (p1 * a + p2 * b);
      J[0] = f_x * (s + a * a * t + 2.0 * p1 * b + 6.0 * p2 * a);
      J[1] = f_x * mixed;
      J[2] = f_y * mixed;
      J[3] = f_y * (s + b * b * t + 6.0 * p1 * b + 2.0 * p2 * a);
    }
  }

  /// The point (a, b) of the plane z = 1 that is seen at a pixel: Project backwards, by Newton's
  /// method, to the rounding of the pixel. False, `point` untouched, where that does not converge:
  /// beyond where the distortion folds the image.
  [[nodiscard]] bool Unproject(const double pixel[2], double point[2]) const {
    const double tolerance = 1e-14 * (std::fabs(pixel[0]) + std::fabs(pixel[1]) + f_x + f_y);
    double a = (pixel[0] - c_x) / f_x, b = (pixel[1] - c_y) / f_y;
    for (int i = 0; i < 20; ++i) {
      double seen[2], J[4];
      Project(a, b, seen, J);
      const double error[2] = {seen[0] - pixel[0], seen[1] - pixel[1]};
      const double determinant = J[0] * J[3] - J[1] * J[2];
      if (!(J[0] > 0.0 && determinant > 0.0)) {
        return false;
      }
      if (std::fabs(error[0]) + std::fabs(error[1]) <= tolerance) {
        point[0] = a;
        point[1] = b;
        return true;
      }
      a -= (J[3] * error[0] - J[1] * error[1]) / determinant;
      b -= (J[0] * error[1] - J[2] * error[0]) / determinant;
    }
    return false;
  }
};

/// Where a camera sees a landmark.
struct PixelObservation {
  double pixel[2] = {0.0, 0.0};  ///< z, pixels
  double sqrt_information[3] = {1.0, 0.0,
                                1.0};  ///< U = [u00 u01; 0 u11], 1/pixel, see SqrtInformation
};

/// Reprojection of a landmark into a pinhole camera with radial-tangential distortion, with
/// analytic Jacobians: what OKVIS estimates. Slots, h and all else as PointObservationFamily has
/// it.
///
///     residual = U (camera(h_xy / h_z) − z)                                    (2 rows, whitened)
///
/// Fails to evaluate where h_z = 0 or a result is not finite. The camera is one for the family; its
/// intrinsics are not estimated (BalReprojectionFamily does that).
class INCERES_EXPORT PointReprojectionFamily final
    : public PointObservationFamily<PixelObservation> {
 public:
  /// For one camera, and landmarks and poses of these kinds.
  explicit PointReprojectionFamily(const PinholeCamera& camera,
                                   LandmarkKind landmark = LandmarkKind::kPoint,
                                   Perturbation perturbation = Perturbation::kRight)
      : PointObservationFamily(2, landmark, perturbation), camera_(camera) {}

  /// The camera of all factors.
  const PinholeCamera& camera() const { return camera_; }
  const char* Name() const override { return "point reprojection"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  PinholeCamera camera_;
};

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
