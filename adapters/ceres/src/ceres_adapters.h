#pragma once

#include <ceres/loss_function.h>
#include <ceres/manifold.h>

#include "inceres/graph/loss.h"
#include "inceres/graph/manifold.h"

namespace inceres::internal {

/// A ceres::Manifold behind the core's interface. Minus is never called: Ceres's adapter for LocalParameterizations aborts there.
class CeresManifold : public Manifold {
 public:
  explicit CeresManifold(const ceres::Manifold* manifold) : manifold_(manifold) {}
  int AmbientSize() const override { return manifold_->AmbientSize(); }
  int TangentSize() const override { return manifold_->TangentSize(); }
  [[nodiscard]] bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    return manifold_->Plus(x, delta, x_plus_delta);
  }
  [[nodiscard]] bool PlusJacobian(const double* x, double* jacobian) const override {
    return manifold_->PlusJacobian(x, jacobian);
  }

 private:
  const ceres::Manifold* manifold_;
};

/// A ceres::LossFunction behind the core's interface.
class CeresLoss : public Loss {
 public:
  explicit CeresLoss(const ceres::LossFunction* loss) : loss_(loss) {}
  void Evaluate(double s, double rho[3]) const override { loss_->Evaluate(s, rho); }

 private:
  const ceres::LossFunction* loss_;
};

}  // namespace inceres::internal
