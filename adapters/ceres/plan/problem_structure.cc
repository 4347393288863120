#include "adapters/ceres/plan/problem_structure.h"

#include <algorithm>

#include "adapters/ceres/plan/landmark_selection.h"

namespace inceres::internal {

ProblemStructure::ProblemStructure(const ProblemView& view, const OrderingView& ordering, ceres::LinearSolverType type)
    : type_(type),
      landmarks_are_given_(LandmarksAreGiven(ordering, type)),
      residuals_(view.residuals.begin(), view.residuals.end()),
      slots_(view.slots) {
  if (landmarks_are_given_) {
    first_group_ = ordering.first_group;
  }
  blocks_.reserve(view.blocks.size());
  for (const ParameterBlockView& block : view.blocks) {
    blocks_.push_back({block.ambient_size, block.tangent_size, block.constant});
  }
}

bool ProblemStructure::IsThatOf(const ProblemView& view, const OrderingView& ordering, ceres::LinearSolverType type) const {
  const auto is_block = [](const Block& a, const ParameterBlockView& b) {
    return a.ambient_size == b.ambient_size && a.tangent_size == b.tangent_size && a.constant == b.constant;
  };
  const auto is_residual = [](const ResidualBlockShape& a, const ResidualBlockShape& b) {
    return a.num_residuals == b.num_residuals && a.first_slot == b.first_slot && a.num_slots == b.num_slots;
  };
  return type_ == type && landmarks_are_given_ == LandmarksAreGiven(ordering, type) &&
         (!landmarks_are_given_ || first_group_ == ordering.first_group) && slots_ == view.slots &&
         std::equal(blocks_.begin(), blocks_.end(), view.blocks.begin(), view.blocks.end(), is_block) &&
         std::equal(residuals_.begin(), residuals_.end(), view.residuals.begin(), view.residuals.end(), is_residual);
}

}  // namespace inceres::internal
