#pragma once

#include "inceres/export.h"
#include "inceres/problem/manifolds.h"

namespace inceres {

/// Pose with a scale, a similarity of space: storage p (3), q (x, y, z, w), s > 0; δ = (δp, φ, σ);
/// p + δp, q ⊗ Exp(φ), s e^σ with σ cut to [−300, 300]. A scale stays on its side of zero, and 0
/// stays 0. As the manifolds of problem/manifolds.h otherwise.
class INCERES_EXPORT SimilarityManifold final : public Manifold {
 public:
  int AmbientSize() const override { return 8; }
  int TangentSize() const override { return 7; }
  [[nodiscard]] bool Plus(const double* x, const double* delta,
                          double* x_plus_delta) const override;
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override;
  [[nodiscard]] bool Minus(const double* y, const double* x, double* delta) const override;
};

}  // namespace inceres
