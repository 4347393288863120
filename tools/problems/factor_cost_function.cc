#include "tools/problems/factor_cost_function.h"

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <iterator>
#include <utility>

#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

namespace inceres::tools {

namespace {

constexpr int kLeadingColumns[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

}  // namespace

FactorCostFunction::FactorCostFunction(std::unique_ptr<const FactorFamily> family)
    : family_(std::move(family)), num_slots_(family_->num_slots()) {
  assert(family_->size() == 1 && num_slots_ <= kMaxSlots);
  set_num_residuals(family_->residual_size());
  for (int s = 0; s < num_slots_; ++s) {
    const FactorFamily::Slot& slot = family_->slot(s);
    assert(slot.tangent_size == slot.ambient_size ||
           slot.tangent_size <= static_cast<int>(std::size(kLeadingColumns)));
    mutable_parameter_block_sizes()->push_back(slot.ambient_size);
    sizes_[s] = {static_cast<std::int16_t>(slot.ambient_size),
                 static_cast<std::int16_t>(slot.tangent_size)};
  }
}

bool FactorCostFunction::Evaluate(double const* const* parameters, double* residuals,
                                  double** jacobians) const {
  FactorBatch batch;
  batch.end = 1;
  batch.parameters = parameters;
  batch.residuals = residuals;
  if (jacobians == nullptr) {
    return !family_->Evaluate(batch).failed();
  }
  TangentMap maps[kMaxSlots];
  const TangentMap* map_of_slot[kMaxSlots];
  JacobianView views[kMaxSlots];
  for (int s = 0; s < num_slots_; ++s) {
    const auto [ambient, tangent] = sizes_[s];
    const bool is_part = tangent < ambient;
    map_of_slot[s] = &maps[s];
    views[s] = {jacobians[s], 0, ambient};
    maps[s].ambient_size = ambient;
    maps[s].tangent_size = tangent;
    if (jacobians[s] == nullptr) {
      maps[s].kind = TangentMap::Kind::kConstant;
    } else if (is_part) {
      maps[s].kind = TangentMap::Kind::kSelection;
      maps[s].selection = kLeadingColumns;
      std::fill_n(jacobians[s], num_residuals() * ambient, 0.0);
    }
  }
  batch.tangent_maps = map_of_slot;
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
