#pragma once

#include <vector>

#include "inceres/export.h"
#include "inceres/graph/factor_family.h"

namespace inceres {

/// Reprojection of a feature between two poses of a body that carries the camera, with analytic Jacobians: what VINS estimates.
/// Slots 0 and 1 are the poses of the body (the IMU) at i, which stores the feature as a bearing and an inverse depth, and at j ≠
/// i; slot 2 is the camera on the body, body_from_camera (t_c, R_c); slot 3 the inverse depth λ (1, 1/m) in the camera at i; slot
/// 4, if it is estimated, the time offset τ (1, s). Poses are [p(3), q(x, y, z, w)] on PoseManifold; no other manifold will do.
///
///     m = m_i − (τ − τ_i) ṁ_i,   z = z_j − (τ − τ_j) ż_j                       (features move on as the clocks disagree)
///     h = R_cᵀ (R_jᵀ (R_i (R_c m + λ t_c) + λ (p_i − p_j)) − λ t_c)            λ times the point in the camera at j
///     residual = U (h_xy / h_z − z)                                            (2 rows, whitened)
///
/// m_i taken as exact, as VINS does, has all observations of a feature share an error that nobody accounts for: covariances then
/// come out too small. With Feature::kBearing slot 3 is (m_x, m_y, λ), three Euclidean values; where the feature was seen at i is
/// then a measurement like the others: DiagonalPriorFamily(2, 3, 3) on that variable.
///
/// h is smooth at λ = 0, a point at infinity. Fails to evaluate where h_z = 0 or a result is not finite; points behind the camera
/// evaluate, as in the model. Without a time offset m = m_i and z = z_j.
///
/// Cost: about 250 multiplications a factor with Jacobians, no transcendental function, nothing allocated. Threads: as
/// FactorFamily; Add is for one writer.
/// Source: Qin & Shen, "Online Temporal Calibration for Monocular Visual-Inertial Systems", 2018; derived in
/// body_reprojection.cc.
class INCERES_EXPORT BodyReprojectionFamily final : public FactorFamily {
 public:
  enum class TimeOffset : unsigned char { kNone, kEstimated };
  enum class Feature : unsigned char {
    kInverseDepth,  ///< slot 3 is λ; its bearing at i is the measurement's
    kBearing,       ///< slot 3 is (m_x, m_y, λ): the bearing is estimated too
  };

  /// Image points are normalised (plane z = 1) unless U says otherwise.
  struct Measurement {
    double point_i[2] = {0.0, 0.0};                ///< m_i: where the feature was first seen; with kBearing of no use
    double point_j[2] = {0.0, 0.0};                ///< z_j: where it is seen at j
    double velocity_i[2] = {0.0, 0.0};             ///< ṁ_i, 1/s; without a time offset of no use
    double velocity_j[2] = {0.0, 0.0};             ///< ż_j, 1/s
    double offset_i = 0.0;                         ///< τ_i: offset already allowed for when the feature was stamped, s
    double offset_j = 0.0;                         ///< τ_j
    double sqrt_information[3] = {1.0, 0.0, 1.0};  ///< U = [u00 u01; 0 u11], see SqrtInformation
  };

  explicit BodyReprojectionFamily(TimeOffset offset = TimeOffset::kNone, Feature feature = Feature::kInverseDepth);

  void Add(const Measurement& measurement) { measurements_.push_back(measurement); }
  /// Overwrites the measurement at `index`, or appends it if index == size().
  void Place(int index, const Measurement& measurement) { PlaceIn(&measurements_, index, measurement); }
  void Reserve(int num_factors) { measurements_.reserve(static_cast<std::size_t>(num_factors)); }

  int size() const override { return static_cast<int>(measurements_.size()); }
  const char* Name() const override { return "body reprojection"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  std::vector<Measurement> measurements_;
};

}  // namespace inceres
