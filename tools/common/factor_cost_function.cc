#include "tools/common/factor_cost_function.h"

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <numeric>
#include <utility>

#include "inceres/graph/manifolds.h"
#include "inceres/graph/rotation.h"

namespace inceres::tools {

FactorCostFunction::FactorCostFunction(std::unique_ptr<const FactorFamily> family) : family_(std::move(family)) {
  assert(family_->size() == 1 && family_->num_slots() <= kMaxSlots);
  set_num_residuals(family_->residual_size());
  int largest = 0;
  for (int s = 0; s < family_->num_slots(); ++s) {
    largest = std::max(largest, family_->slot(s).tangent_size);
  }
  leading_columns_.resize(static_cast<std::size_t>(largest));
  std::iota(leading_columns_.begin(), leading_columns_.end(), 0);
  for (int s = 0; s < family_->num_slots(); ++s) {
    const FactorFamily::Slot& slot = family_->slot(s);
    mutable_parameter_block_sizes()->push_back(slot.ambient_size);
    maps_[s].ambient_size = slot.ambient_size;
    maps_[s].tangent_size = slot.tangent_size;
    if (slot.tangent_size < slot.ambient_size) {
      maps_[s].kind = TangentMap::Kind::kSelection;
      maps_[s].selection = leading_columns_.data();
    }
  }
}

bool FactorCostFunction::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  FactorBatch batch;
  batch.end = 1;
  batch.parameters = parameters;
  batch.residuals = residuals;
  if (jacobians == nullptr) {
    return !family_->Evaluate(batch).failed();
  }
  static const TangentMap kConstant{TangentMap::Kind::kConstant, 0, 0, nullptr, nullptr};
  const TangentMap* maps[kMaxSlots];
  JacobianView views[kMaxSlots];
  for (int s = 0; s < family_->num_slots(); ++s) {
    maps[s] = jacobians[s] == nullptr ? &kConstant : &maps_[s];
    views[s] = {jacobians[s], 0, maps_[s].ambient_size};
    if (jacobians[s] != nullptr && maps_[s].tangent_size < maps_[s].ambient_size) {
      std::fill_n(jacobians[s], num_residuals() * maps_[s].ambient_size, 0.0);
    }
  }
  batch.tangent_maps = maps;
  batch.jacobians = views;
  return !family_->Evaluate(batch).failed();
}

bool PoseBlockManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  return PoseManifold().Plus(x, delta, x_plus_delta);
}

bool PoseBlockManifold::PlusJacobian(const double* /*x*/, double* jacobian) const {
  std::fill_n(jacobian, 42, 0.0);
  for (int k = 0; k < 6; ++k) {
    jacobian[7 * k] = 1.0;
  }
  return true;
}

bool PoseBlockManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  for (int k = 0; k < 3; ++k) {
    y_minus_x[k] = y[k] - x[k];
  }
  const double q_inverse[4] = {-x[3], -x[4], -x[5], x[6]};
  double turn[4];
  MultiplyQuaternions(q_inverse, y + 3, turn);
  LogQuaternion(turn, y_minus_x + 3);
  return true;
}

bool PoseBlockManifold::MinusJacobian(const double* /*x*/, double* jacobian) const {
  std::fill_n(jacobian, 42, 0.0);
  for (int k = 0; k < 6; ++k) {
    jacobian[8 * k] = 1.0;
  }
  return true;
}

}  // namespace inceres::tools
