#pragma once

#include "inceres/export.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

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
/// baseline that is known, or what holds the scale of a problem that has none (HoldGauge).
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

/// How the position and orientation of the whole problem are held.
enum class GaugeReference : unsigned char {
  /// The reference is made constant: all of it. Of a BAL camera that is more than the gauge, for
  /// its focal length and distortion stay as they are.
  kConstant,
  /// A prior holds its pose where it is. The other factors do not mind where that is, so the
  /// prior costs nothing at a minimum and changes none: only the gauge is held.
  kPrior,
};

/// How the scale of the whole problem is held.
enum class GaugeScale : unsigned char {
  kMeasured,    ///< not at all: an IMU, a stereo camera, relative poses or depths measure it
  kDistance,    ///< by the distance between the centers of the reference and of another one
  kCoordinate,  ///< by one coordinate of another one
};

/// Options of HoldGauge. Variables that are −1 are chosen.
struct INCERES_EXPORT GaugeOptions {
  CenterKind kind = CenterKind::kPose;                      ///< of the variables that are held
  GaugeReference reference_by = GaugeReference::kConstant;  ///< of position and orientation
  VariableId reference = -1;                                ///< −1: the first frame of this kind
  GaugeScale scale_by = GaugeScale::kMeasured;              ///< of the scale
  VariableId other = -1;  ///< of the scale; −1: the one whose center is furthest from the reference
  /// of kCoordinate: index among the values of the other; −1: the position's that matters most
  int coordinate = -1;
};

/// What HoldGauge has held.
struct HeldGauge {
  VariableId reference = -1;       ///< what is held
  VariableId other = -1;           ///< −1: the scale is not held
  int coordinate = -1;             ///< of the other; −1: not by a coordinate
  double distance = 0.0;           ///< between the centers, of kDistance
  FamilyId reference_family = -1;  ///< of the prior of kPrior
  FamilyId scale_family = -1;      ///< of the factor that holds the scale
};

/// Fixes the gauge of a problem: the motions of all of it together that no factor measures. A
/// bundle adjustment of monocular images has seven (rotation, translation, scale), a pose graph six
/// or, in the plane, three. Solve needs none of this, for its damping keeps the whole from
/// drifting; but covariances exist only without a free gauge, and two results compare only in one
/// gauge.
///
/// What is held is held at its values now. Scale is held by a factor of its own family, with one
/// row that is 0 now: distance relative to what it is now, or coordinate. Because only the gauge
/// moves it, it costs nothing at a minimum. Exact up to convergence, that is: by how much a solve
/// stops short, and no more, the prior and the scale may be off.
///
/// kInvalidArgument, graph unchanged: no frame of this kind, or an id that is none (removed, of
/// other sizes, a landmark, borrowed); the same variable twice; another one that is constant, for
/// then its distance cannot be held; kPrior of a pose that is not on PoseManifold or
/// LeftPoseManifold; scale of a kPlanarPose; centers that coincide; a coordinate that is no
/// position's, or that does not change when the scale does.
///
/// Where factors measure the gauge (a prior on a pose, GPS) do not use this: what is held and what
/// they say would disagree. Cost: a pass over the variables.
INCERES_EXPORT Status HoldGauge(const GaugeOptions& options, FactorGraph* graph,
                                HeldGauge* held = nullptr);

}  // namespace inceres
