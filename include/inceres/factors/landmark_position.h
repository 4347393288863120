#pragma once

#include "inceres/export.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

/// How a planar landmark was measured.
enum class PlanarSighting {
  kPosition,      ///< x, y in the axes of the pose, meters: g2o's EDGE_SE2_XY
  kRangeBearing,  ///< distance in meters, angle in radians from the pose's x axis
};

/// Where the landmark was seen, and how well that is known.
struct PlanarLandmarkMeasurement {
  double z[2] = {0.0, 0.0};                       ///< x and y, or distance and angle
  double sqrt_information[4] = {1.0, 0, 0, 1.0};  ///< U, row-major, upper triangular
};

/// A planar landmark seen from a planar pose, with analytic Jacobians. Slots: the pose [x y θ], and
/// the landmark [x y], which may be a frame or, with Role::kLandmark, eliminated first.
///
///     d = R(θ)ᵀ (l − p)
///     kPosition:     residual = U (d − z)
///     kRangeBearing: residual = U [‖d‖ − z_0; wrap(atan2(d_y, d_x) − z_1)]
///
/// (2 rows, whitened.) Range and bearing fail to evaluate where landmark and pose coincide. Cost:
/// an angle a factor, nothing allocated. Threads: as FactorFamily; Add is for one writer. Source:
/// Thrun, Burgard & Fox, "Probabilistic Robotics", 2005, section 6.6.
class INCERES_EXPORT PlanarLandmarkFamily final
    : public MeasuredFamily<PlanarLandmarkMeasurement, AmbientFamily<PlanarLandmarkFamily>> {
 public:
  /// For measurements of this kind.
  explicit PlanarLandmarkFamily(PlanarSighting sighting = PlanarSighting::kPosition)
      : MeasuredFamily(2, {{3, 3}, {2, 2}}), sighting_(sighting) {}

  /// What its measurements are.
  PlanarSighting sighting() const { return sighting_; }

  const char* Name() const override { return "planar landmark"; }

  /// For AmbientFamily.
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const;

 private:
  PlanarSighting sighting_;
};

/// Where the landmark was seen, and how well that is known.
struct SpatialLandmarkMeasurement {
  double z[3] = {0.0, 0.0, 0.0};  ///< meters, in the axes of the pose
  double sqrt_information[9] = {1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0};  ///< U, upper triangular
};

/// A landmark in space whose place in a pose's axes was measured, with analytic Jacobians: g2o's
/// EDGE_SE3_TRACKXYZ without an offset. Slots: the pose [p(3), q(x, y, z, w)] on PoseManifold, no
/// other will do, and the landmark (3), which may be a frame or eliminated first.
///
///     residual = U (Rᵀ (l − p) − z)                                  (3 rows, meters; whitened)
///
/// Fails to evaluate where a result is not finite. Cost: some 3×3 products a factor, nothing
/// allocated. Threads: as FactorFamily; Add is for one writer. Source: Sola, Deray & Atchuthan, "A
/// micro Lie theory for state estimation in robotics", 2018, section V.
class INCERES_EXPORT SpatialLandmarkFamily final
    : public MeasuredFamily<SpatialLandmarkMeasurement> {
 public:
  SpatialLandmarkFamily() : MeasuredFamily(3, {{7, 6}, {3, 3}}) {}

  const char* Name() const override { return "spatial landmark"; }
  SlotSpace Space(int s) const override {
    return s == 0 ? SlotSpace::kPose : SlotSpace::kEuclidean;
  }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
};

/// Where the antenna is, and how well that is known.
struct PositionMeasurement {
  double z[3] = {0.0, 0.0, 0.0};      ///< meters, in the world
  double lever[3] = {0.0, 0.0, 0.0};  ///< c, the antenna's place in the axes of the pose, meters
  double sqrt_information[9] = {1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0};  ///< U, upper triangular
};

/// A measured position of a pose in the world, as a GPS gives it, with the lever of the antenna;
/// with analytic Jacobians. One slot: the pose [p(3), q(x, y, z, w)] on PoseManifold, no other will
/// do.
///
///     residual = U (p + R c − z)                                     (3 rows, meters; whitened)
///
/// Fails to evaluate where a result is not finite. Cost and threads: as SpatialLandmarkFamily.
/// Source: as there.
class INCERES_EXPORT PositionPriorFamily final : public MeasuredFamily<PositionMeasurement> {
 public:
  PositionPriorFamily() : MeasuredFamily(3, {{7, 6}}) {}

  const char* Name() const override { return "position prior"; }
  SlotSpace Space(int /*s*/) const override { return SlotSpace::kPose; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
};

}  // namespace inceres
