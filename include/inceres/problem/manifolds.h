#pragma once

#include <memory>
#include <vector>

#include "inceres/export.h"

namespace inceres {

/// A space a variable lives on: x ⊞ δ moves x (ambient size a) along a tangent vector δ (size d ≤
/// a).
///
/// A Euclidean variable needs no manifold (null pointer). Implement this class for a space of your
/// own; the built-in ones follow. Calls of Plus and PlusJacobian by the solver come from the
/// solving thread only, never concurrently. Minus, which only prior factors use
/// (solver/marginalization.h), is called while factors are evaluated, so from any of the solver's
/// threads, several at once; and Plus with it, as long as Minus is the default one, which calls
/// Plus.
class INCERES_EXPORT Manifold {
 public:
  virtual ~Manifold() = default;

  /// Number of doubles that store a point, a.
  virtual int AmbientSize() const = 0;

  /// Degrees of freedom, d. Zero makes the variable a constant.
  virtual int TangentSize() const = 0;

  /// x_plus_delta = x ⊞ delta. x and x_plus_delta have AmbientSize() entries and may alias; delta
  /// has TangentSize(). Returns false when the result is undefined; the solver then treats the step
  /// as one that cannot be evaluated.
  [[nodiscard]] virtual bool Plus(const double* x, const double* delta,
                                  double* x_plus_delta) const = 0;

  /// ∂(x ⊞ δ)/∂δ at δ = 0, row-major AmbientSize() × TangentSize(). Must satisfy PlusJacobian = d
  /// Plus exactly: the projection of a user's ambient Jacobian is J_ambient · PlusJacobian. Returns
  /// false when undefined at x.
  [[nodiscard]] virtual bool PlusJacobian(const double* x, double* jacobian) const = 0;

  /// delta = y ⊟ x: the δ with x ⊞ δ = y, the shortest where there are several. y and x have
  /// AmbientSize() entries, delta has TangentSize() and aliases neither. Returns false where there
  /// is none, or none can be found.
  ///
  /// The default solves x ⊞ δ = y by Newton's method from δ = 0 with central differences of Plus,
  /// to the last few digits: some 2 d calls of Plus a step and a few steps, with allocations. It
  /// finds the δ near zero and does not know that a point may have two representations (q and −q):
  /// override it where a closed form is known, as all built-in manifolds do. Whoever calls it calls
  /// Plus, so Plus has to bear calls from several threads at once where Minus has.
  [[nodiscard]] virtual bool Minus(const double* y, const double* x, double* delta) const;
};

/// \file
/// The built-in manifolds. Angles are radians; quaternions are unit Hamilton quaternions. Nothing
/// here normalizes a quaternion: ⊞ keeps the norm it finds up to rounding, so that x ⊞ 0 = x to the
/// last bit and PlusJacobian is exact at any x.
///
/// Minus is a closed form everywhere: of rotations the one by at most π, with q and −q the same
/// point; false at the antipode of a sphere, after whole turns of a planar pose, and where ⊞ itself
/// is undefined. What a SubsetManifold holds constant is not looked at.
///
/// None allocates in Plus, PlusJacobian or Minus; all are immutable and may be shared by variables,
/// graphs and threads. Source: Hertzberg et al., "Integrating generic sensor fusion algorithms with
/// sound state representations through encapsulation of manifolds", 2013; Sola, Deray & Atchuthan,
/// "A micro Lie theory for state estimation in robotics", 2018.

/// Rⁿ: x + δ. A null manifold means the same and is cheaper; this class is for ProductManifold.
class INCERES_EXPORT EuclideanManifold final : public Manifold {
 public:
  /// Of so many coordinates.
  explicit EuclideanManifold(int size) : size_(size) {}
  int AmbientSize() const override { return size_; }
  int TangentSize() const override { return size_; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;

 private:
  int size_;
};

/// Rⁿ with some coordinates held constant; δ moves the others, in their order. Without any left the
/// tangent size is 0 and the variable is a constant. An index outside [0, n) is a mistake: Plus and
/// PlusJacobian then return false.
class INCERES_EXPORT SubsetManifold final : public Manifold {
 public:
  /// Of `size` coordinates, those of constant_indices held; indices out of range are a mistake.
  SubsetManifold(int size, const std::vector<int>& constant_indices);
  /// The coordinates that move, ascending.
  const std::vector<int>& free_indices() const { return free_; }
  int AmbientSize() const override { return size_; }
  int TangentSize() const override { return static_cast<int>(free_.size()); }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;

 private:
  int size_;
  bool valid_ = true;
  std::vector<int> free_;  // the coordinates that move, ascending
};

/// Several manifolds side by side: the values of the first, then of the second, …; the tangent
/// vector likewise. A null component is a mistake: it has size 0, and Plus and PlusJacobian then
/// return false.
class INCERES_EXPORT ProductManifold final : public Manifold {
 public:
  /// These, in this order.
  explicit ProductManifold(std::vector<std::shared_ptr<const Manifold>> components);
  /// The manifolds it is made of, in order.
  const std::vector<std::shared_ptr<const Manifold>>& components() const { return components_; }
  int AmbientSize() const override { return ambient_size_; }
  int TangentSize() const override { return tangent_size_; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;

 private:
  std::vector<std::shared_ptr<const Manifold>> components_;
  int ambient_size_ = 0;
  int tangent_size_ = 0;
};

/// The sphere of radius ‖x‖ in Rⁿ, tangent size n − 1: homogeneous points and directions. δ moves x
/// by the angle ‖δ‖ along a great circle,
///
///     x ⊞ δ = cos‖δ‖ x + ‖x‖ sinc‖δ‖ B δ,
///
/// with B (n × n−1) an orthonormal basis of the complement of x (Householder). Undefined (returns
/// false) at x = 0. B jumps where x_n changes sign, which is harmless: it is fixed within a
/// linearization. Source: Hartley & Zisserman, "Multiple View Geometry", 2nd ed., appendix 6.9.3.
class INCERES_EXPORT SphereManifold final : public Manifold {
 public:
  /// Of points with so many coordinates, at least 2.
  explicit SphereManifold(int ambient_size) : size_(ambient_size) {}
  int AmbientSize() const override { return size_; }
  int TangentSize() const override { return size_ - 1; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;

 private:
  int size_;
};

/// Rotation as in Ceres 2.1's QuaternionManifold: storage w, x, y, z and
///     q ⊞ δ = [cos‖δ‖, sinc(‖δ‖) δ] ⊗ q,
/// a perturbation on the left by *twice* the angle ‖δ‖.
class INCERES_EXPORT QuaternionManifold final : public Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 3; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

/// QuaternionManifold with Eigen's storage x, y, z, w: Ceres 2.1's EigenQuaternionManifold.
class INCERES_EXPORT EigenQuaternionManifold final : public Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 3; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

/// Rotation with a right perturbation by a rotation vector, q ⊞ φ = q ⊗ Exp(φ): R Exp(φ), the
/// convention of VINS, XRSLAM and most inertial estimators. Storage x, y, z, w.
class INCERES_EXPORT RotationQuaternionManifold final : public Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 3; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

/// Pose as SO(3) × R³: storage p (3), q (x, y, z, w); δ = (δp, φ); p + δp, q ⊗ Exp(φ).
class INCERES_EXPORT PoseManifold final : public Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

/// PoseManifold perturbed on the left: storage p (3), q (x, y, z, w); δ = (δp, φ), both in the
/// world frame; p + δp, Exp(φ) ⊗ q. The convention of OKVIS.
class INCERES_EXPORT LeftPoseManifold final : public Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

/// Pose as a rigid motion T = (R, p): storage p (3), q (x, y, z, w); ξ = (ρ, φ), translation first;
/// T Exp(ξ):
///     p + R J_l(φ) ρ,   q ⊗ Exp(φ).
class INCERES_EXPORT SE3Manifold final : public Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

/// Pose with a scale, a similarity of space: storage p (3), q (x, y, z, w), s > 0; δ = (δp, φ, σ);
/// p + δp, q ⊗ Exp(φ), s e^σ with σ cut to [−300, 300]. A scale stays on its side of zero, and 0
/// stays 0.
class INCERES_EXPORT SimilarityManifold final : public Manifold {
 public:
  int AmbientSize() const override { return 8; }
  int TangentSize() const override { return 7; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

/// Planar pose: storage x, y, θ; ξ = (ρ (2), ω); T Exp(ξ):
///     (x, y) + R(θ) V(ω) ρ,   θ + ω,    V(ω) = [sin ω, −(1 − cos ω); 1 − cos ω, sin ω] / ω.
/// θ is not wrapped: a factor that compares angles wraps their difference. Minus is false after
/// whole turns, where V is singular.
class INCERES_EXPORT SE2Manifold final : public Manifold {
 public:
  int AmbientSize() const override { return 3; }
  int TangentSize() const override { return 3; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

/// On which side a rotation is perturbed: which manifold the poses of a factor are on.
enum class Perturbation : unsigned char {
  kRight,  ///< R Exp(φ): PoseManifold; VINS, XRSLAM
  kLeft,   ///< Exp(φ) R: LeftPoseManifold; OKVIS
};

}  // namespace inceres
