#pragma once

#include <utility>
#include <vector>

#include <ceres/cost_function.h>

#include "inceres/problem/ambient_family.h"

namespace inceres::internal {

/// A user's cost functions of one shape. They are called directly, one after the other, with Ceres's conventions: null Jacobians
/// in cost-only calls and for constant blocks, row-major ambient Jacobians otherwise, outputs filled beforehand and checked
/// afterwards (docs/ceres_contract.md, "Evaluation"). Only the order of the calls is ours. Borrows the cost functions for the
/// length of a solve.
class CostFunctionFamily : public AmbientFamily<CostFunctionFamily> {
 public:
  CostFunctionFamily(int num_residuals, std::vector<Slot> slots, std::vector<const ceres::CostFunction*> costs)
      : AmbientFamily<CostFunctionFamily>(num_residuals, std::move(slots)), costs_(std::move(costs)) {}

  int size() const override { return static_cast<int>(costs_.size()); }
  const char* Name() const override { return "ceres::CostFunction"; }
  std::string Describe(int i) const override { return DescribeObject("cost function", costs_[static_cast<std::size_t>(i)]); }

  bool EvaluateOne(int i, const double* const* parameters, double* residuals, double** jacobians) const {
    return costs_[static_cast<std::size_t>(i)]->Evaluate(parameters, residuals, jacobians);
  }

 private:
  std::vector<const ceres::CostFunction*> costs_;
};

}  // namespace inceres::internal
