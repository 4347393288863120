#pragma once

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

}  // namespace inceres
