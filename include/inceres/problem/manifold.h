#pragma once

#include "inceres/export.h"

namespace inceres {

/// A space a variable lives on: x ⊞ δ moves x (ambient size a) along a tangent vector δ (size d ≤ a).
///
/// A Euclidean variable needs no manifold (null pointer). Implement this class for a space of your own; the built-in ones are
/// in graph/manifolds.h. Calls of Plus and PlusJacobian by the solver come from the solving thread only, never concurrently;
/// Minus, which only prior factors use (solver/linear_prior.h), is called while factors are evaluated, so from any of the
/// solver's threads.
class INCERES_EXPORT Manifold {
 public:
  virtual ~Manifold() = default;

  /// Number of doubles that store a point, a.
  virtual int AmbientSize() const = 0;

  /// Degrees of freedom, d. Zero makes the variable a constant.
  virtual int TangentSize() const = 0;

  /// x_plus_delta = x ⊞ delta. x and x_plus_delta have AmbientSize() entries and may alias; delta has TangentSize().
  /// Returns false when the result is undefined; the solver then treats the step as one that cannot be evaluated.
  [[nodiscard]] virtual bool Plus(const double* x, const double* delta, double* x_plus_delta) const = 0;

  /// ∂(x ⊞ δ)/∂δ at δ = 0, row-major AmbientSize() × TangentSize(). Must satisfy PlusJacobian = d Plus exactly: the projection
  /// of a user's ambient Jacobian is J_ambient · PlusJacobian. Returns false when undefined at x.
  [[nodiscard]] virtual bool PlusJacobian(const double* x, double* jacobian) const = 0;

  /// delta = y ⊟ x: the δ with x ⊞ δ = y, the shortest where there are several. y and x have AmbientSize() entries, delta has
  /// TangentSize() and aliases neither. Returns false where there is none, or none can be found.
  ///
  /// The default solves x ⊞ δ = y by Newton's method from δ = 0 with central differences of Plus, to the last few digits: some
  /// 2 d calls of Plus a step and a few steps, with allocations. It finds the δ near zero and does not know that a point may have
  /// two representations (q and −q): override it where a closed form is known, as all built-in manifolds do.
  [[nodiscard]] virtual bool Minus(const double* y, const double* x, double* delta) const;
};

}  // namespace inceres
