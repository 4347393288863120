#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include <ceres/cost_function.h>

#include "inceres/graph/ambient_family.h"

namespace inceres::tools {

/// Cost functions of one shape, written for Ceres, as a family that grows: what a user of the core does with AutoDiff costs.
class AutoDiffFamily final : public AmbientFamily<AutoDiffFamily> {
 public:
  using Measurement = std::shared_ptr<const ceres::CostFunction>;

  AutoDiffFamily(int residual_size, std::vector<Slot> slots) : AmbientFamily<AutoDiffFamily>(residual_size, std::move(slots)) {}

  void Add(const Measurement& cost) { costs_.push_back(cost); }
  /// Puts the cost function at an index: one in use or the next one.
  void Place(int index, const Measurement& cost) { PlaceIn(&costs_, index, cost); }

  int size() const override { return static_cast<int>(costs_.size()); }
  const char* Name() const override { return "AutoDiff cost function"; }

  bool EvaluateOne(int i, const double* const* parameters, double* residuals, double** jacobians) const {
    return costs_[static_cast<std::size_t>(i)]->Evaluate(parameters, residuals, jacobians);
  }

 private:
  std::vector<Measurement> costs_;
};

}  // namespace inceres::tools
