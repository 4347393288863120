#pragma once

#include "inceres/export.h"

namespace inceres {

/// A space a variable lives on: x ⊞ δ moves x (ambient size a) along a tangent vector δ (size d ≤ a).
///
/// A Euclidean variable needs no manifold (null pointer). Implement this class for a space of your own; the built-in ones are
/// in graph/manifolds.h. Calls come from the solving thread only, never concurrently.
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
};

}  // namespace inceres
