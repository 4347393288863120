#pragma once

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

/// Image points are in the plane z = 1, without distortion.
struct BodyObservation {
  double point_i[2] = {0.0,
                       0.0};  ///< m_i: where the feature was first seen; with kBearing of no use
  double point_j[2] = {0.0, 0.0};     ///< z_j: where it is seen at j
  double velocity_i[2] = {0.0, 0.0};  ///< ṁ_i, 1/s; without a time offset of no use
  double velocity_j[2] = {0.0, 0.0};  ///< ż_j, 1/s
  double offset_i = 0.0;  ///< τ_i: offset already allowed for when the feature was stamped, s
  double offset_j = 0.0;  ///< τ_j
  double sqrt_information[3] = {1.0, 0.0, 1.0};  ///< U = [u00 u01; 0 u11], see SqrtInformation
};

/// Reprojection of an inverse-depth feature between cameras on a body, with analytic Jacobians:
/// what VINS estimates. Frame i stores the feature as a bearing and an inverse depth λ (1, 1/m) in
/// its camera, frame j sees it. Slots, by `Views`:
///
///     kTwoPoses             pose i, pose j, camera, λ
///     kTwoPosesTwoCameras   pose i, pose j, camera i, camera j, λ
///     kOnePoseTwoCameras    camera i, camera j, λ                  both at one time
///
/// (VINS's ProjectionFactor or TwoFrameOneCam, its TwoFrameTwoCam and its OneFrameTwoCam),
/// and, if it is estimated, the time offset τ (1, s) at the end. With Feature::kBearing the bearing
/// is estimated too and λ's slot is (m_x, m_y, λ), three Euclidean values: m_i taken as exact, as
/// VINS does, has all observations of a feature share an error that nobody accounts for, and
/// covariances come out too small. Where the feature was seen at i is then a measurement like the
/// others: DiagonalPriorFamily(2, 3, 3) on that variable. A pose (p, R) is that of the body (the
/// IMU) in the world, a camera (t_c, R_c) is body_from_camera; both [p(3), q(x, y, z, w)] on
/// PoseManifold; no other manifold will do. No two slots of a factor may be one variable.
///
///     m = m_i − (τ − τ_i) ṁ_i,   z = z_j − (τ − τ_j) ż_j
///     h = R_cjᵀ (R_jᵀ (R_i (R_ci m + λ t_ci) + λ (p_i − p_j)) − λ t_cj)
///     residual = U (h_xy / h_z − z)                      kPlane: 2 rows, whitened
///     residual = U B (h / ‖h‖ − (z, 1) / ‖(z, 1)‖)       kUnitSphere: 2 rows, whitened
///
/// Features move on by as much as the clocks disagree: m and z are where they are at one time. h is
/// λ times the point in camera j. With one pose R_jᵀ R_i = I and p_i = p_j. B (2×3) spans the
/// tangent plane of the sphere at z_j, its rows near the image's x and y when z_j is near the axis:
/// VINS's UNIT_SPHERE_ERROR, for wide lenses; it is 0 in the opposite direction as well.
///
/// h is smooth at λ = 0, a point at infinity. Fails to evaluate where h_z = 0 (kUnitSphere: h = 0)
/// or a result is not finite; points behind the camera evaluate, as in the model. Without a time
/// offset m = m_i and z = z_j.
///
/// Cost: about 250 multiplications a factor with Jacobians, no transcendental function, nothing
/// allocated. Threads: as FactorFamily; Add is for one writer. Source: Qin & Shen, "Online Temporal
/// Calibration for Monocular Visual-Inertial Systems", 2018; Qin, Li & Shen, "VINS-Mono", 2018, eq.
/// 25 (the unit sphere); derived in inverse_depth_chain.h.
class INCERES_EXPORT BodyReprojectionFamily final : public MeasuredFamily<BodyObservation> {
 public:
  /// Whether the clocks' offset τ is a variable.
  enum class TimeOffset : unsigned char {
    kNone,       ///< it is not
    kEstimated,  ///< it is: the last slot
  };
  /// What the landmark's variable holds.
  enum class Feature : unsigned char {
    kInverseDepth,  ///< λ; its bearing at i is the measurement's
    kBearing,       ///< (m_x, m_y, λ)
  };
  /// Which poses and cameras the two views are from.
  enum class Views : unsigned char {
    kTwoPoses,            ///< of one camera, at two times
    kTwoPosesTwoCameras,  ///< of two cameras, at two times
    kOnePoseTwoCameras,   ///< of two cameras, at one time
  };
  /// Where the error is measured: in the plane z = 1, or across the ray.
  enum class Error : unsigned char {
    kPlane,       ///< h_xy / h_z − z_j
    kUnitSphere,  ///< B (h / ‖h‖ − d)
  };

  /// For factors of these kinds: they decide the slots.
  explicit BodyReprojectionFamily(TimeOffset offset = TimeOffset::kNone,
                                  Feature feature = Feature::kInverseDepth,
                                  Views views = Views::kTwoPoses, Error error = Error::kPlane);

  /// Whether and how a time offset is estimated.
  TimeOffset time_offset() const { return offset_; }
  /// What an image measures.
  Feature feature() const { return feature_; }
  /// Between which images.
  Views views() const { return views_; }
  /// In which plane the residual lies.
  Error error() const { return error_; }

  const char* Name() const override { return "body reprojection"; }
  SlotSpace Space(int s) const override {
    return slot(s).ambient_size == 7 ? SlotSpace::kPose : SlotSpace::kEuclidean;
  }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  template <int poses, int cameras>
  EvaluationFailure EvaluateViews(const FactorBatch& batch) const;

  TimeOffset offset_;
  Feature feature_;
  Views views_;
  Error error_;
};

/// Image points are normalized (plane z = 1) unless U says otherwise.
struct InverseDepthObservation {
  double anchor_point[2] = {0.0,
                            0.0};  ///< x_a, y_a: where the anchor sees the feature; taken as exact
  double observed_point[2] = {0.0, 0.0};         ///< z_b: where b sees it
  double sqrt_information[3] = {1.0, 0.0, 1.0};  ///< U = [u00 u01; 0 u11], see SqrtInformation
};

/// Reprojection of a feature that its anchor, the keyframe that saw it first, stores as a bearing
/// and an inverse depth; with analytic Jacobians. Slot 0 is the pose of the anchor a, slot 1 that
/// of the observing keyframe b ≠ a, slot 2 the inverse depth d (1, 1/m). Poses are [p(3), q(x, y,
/// z, w)] on PoseManifold (problem/manifolds.h): p the camera's center in the world, R = R(q)
/// world_from_camera, (δp, φ) ↦ (p + δp, R Exp(φ)). No other manifold on the poses will do:
/// Jacobians are written in its tangent.
///
///     h = R_bᵀ (R_a m_a + d (p_a − p_b)),   m_a = (x_a, y_a, 1)
///     residual = U (h_xy / h_z − z_b)        (2 rows, whitened)
///
/// h is d times the point in camera coordinates of b. It is smooth at d = 0, a point at infinity.
/// Fails to evaluate where h_z = 0 or a result is not finite; points behind the camera evaluate, as
/// in the model.
///
/// Cost: about 150 multiplications a factor with Jacobians, no transcendental function, nothing
/// allocated. Threads: as FactorFamily; Add is for one writer. Source: Civera, Davison & Montiel,
/// "Inverse depth parametrization for monocular SLAM", 2008; derived in
/// inverse_depth_reprojection.cc.
class INCERES_EXPORT InverseDepthReprojectionFamily final
    : public MeasuredFamily<InverseDepthObservation> {
 public:
  InverseDepthReprojectionFamily() : MeasuredFamily(2, {{7, 6}, {7, 6}, {1, 1}}) {}

  const char* Name() const override { return "inverse-depth reprojection"; }
  SlotSpace Space(int s) const override { return s < 2 ? SlotSpace::kPose : SlotSpace::kEuclidean; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
};

}  // namespace inceres
