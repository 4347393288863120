#pragma once

#include <cstdint>
#include <memory>
#include <utility>

#include <ceres/cost_function.h>
#include <ceres/manifold.h>

#include "inceres/problem/factor_family.h"

namespace inceres::tools {

/// One of our analytic factors as a cost function of Ceres. A family writes tangent Jacobians;
/// where a slot's tangent is smaller than its ambient space (poses), they go into the leading
/// columns of Ceres's ambient Jacobian and the rest is zero, so the parameter block's manifold must
/// have the PlusJacobian [I; 0]: PoseBlockManifold below. Source of the trick: VINS-Mono.
class FactorCostFunction : public ceres::CostFunction {
 public:
  /// The factor is the family's first and only one. A slot with equal sizes is Euclidean here; a
  /// manifold of Ceres on its block projects as usual.
  explicit FactorCostFunction(std::unique_ptr<const FactorFamily> family);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  static constexpr int kMaxSlots = 4;
  struct SlotSize {
    std::int16_t ambient = 0, tangent = 0;
  };

  std::unique_ptr<const FactorFamily> family_;
  int num_slots_;
  // here, because an evaluation waits for every other place it has to look at
  SlotSize sizes_[kMaxSlots];
};

/// A cost function of one factor with that measurement, of a Family made with these arguments. The
/// caller owns it.
template <typename Family, typename... Arguments>
ceres::CostFunction* MakeFactorCost(const typename Family::Measurement& measurement,
                                    const Arguments&... arguments) {
  auto family = std::make_unique<Family>(arguments...);
  family->Add(measurement);
  return new FactorCostFunction(std::move(family));
}

/// PoseManifold (graph/manifolds.h) for the blocks of FactorCostFunction: the same ⊞, but a
/// PlusJacobian of [I; 0], which turns the tangent Jacobians that the cost functions hand out as
/// ambient ones into what they are. Of no use with other cost functions.
class PoseBlockManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

}  // namespace inceres::tools
