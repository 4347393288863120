#include "adapters/ceres/plan/graph_plan.h"

#include <algorithm>
#include <utility>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

class Planner {
 public:
  Planner(const ProblemView& view, const ShapeTable& shapes, LandmarkSelection landmarks)
      : view_(view), shapes_(shapes), variable_of_(view.blocks.size(), -1) {
    plan_.landmarks = std::move(landmarks);
  }

  GraphPlan Run() {
    PlanVariables();
    SortByLandmark();
    PlanFamilies();
    return std::move(plan_);
  }

 private:
  // Blocks by first appearance: constants and frames get their ids as they come, landmarks wait.
  void PlanVariables() {
    std::vector<int> landmark_blocks;
    landmark_blocks.reserve(At(plan_.landmarks.num_landmarks));
    constexpr VariableId kWaiting = -2;
    for (const int b : plan_.landmarks.frames_in_order) {
      PlanVariable(b);
    }
    for (const int r : view_.moving) {
      const ResidualBlockView& residual = view_.residuals[At(r)];
      if (residual.like_previous) {
        continue;  // brings no new ones
      }
      const int* const slots = view_.SlotsOf(residual);
      for (const int* slot = slots; slot < slots + residual.num_slots; ++slot) {
        const int b = *slot;
        if (variable_of_[At(b)] != -1) {
          continue;
        }
        if (plan_.landmarks.Contains(b)) {
          variable_of_[At(b)] = kWaiting;
          landmark_blocks.push_back(b);
        } else {
          PlanVariable(b);
        }
      }
    }
    first_landmark_ = static_cast<VariableId>(plan_.blocks.size());
    for (const int b : landmark_blocks) {
      PlanVariable(b);
    }
  }

  void PlanVariable(int b) {
    variable_of_[At(b)] = static_cast<VariableId>(plan_.blocks.size());
    plan_.blocks.push_back(b);
  }

  // The residual blocks by landmark, those without one last; program order within each.
  void SortByLandmark() {
    const int num_landmarks = plan_.landmarks.num_landmarks;
    landmark_slot_.assign(view_.residuals.size(), -1);
    std::vector<int> row_of;
    row_of.reserve(view_.moving.size());
    for (const int r : view_.moving) {
      const ResidualBlockView& residual = view_.residuals[At(r)];
      const int slot =
          view_.FindSlot(residual, [this](int b) { return plan_.landmarks.Contains(b); });
      landmark_slot_[At(r)] = slot;
      row_of.push_back(slot < 0
                           ? num_landmarks
                           : variable_of_[At(view_.SlotsOf(residual)[slot])] - first_landmark_);
    }
    if (std::is_sorted(row_of.begin(), row_of.end())) {
      order_ = view_.moving;
      return;
    }
    order_ = SortIntoRows(At(num_landmarks) + 1, [&](const auto& add) {
               for (std::size_t k = 0; k < row_of.size(); ++k) {
                 add(row_of[k], view_.moving[k]);
               }
             }).items;
  }

  void PlanFamilies() {
    // A family for each shape and slot of the landmark (slot -1: none): place numbers of the
    // shapes, one more for each shape.
    std::vector<int> family_at(At(shapes_.num_places) + shapes_.shapes.size(), -1);
    std::vector<int> family_of(order_.size());
    std::vector<std::vector<int>> members;
    std::vector<std::size_t> sizes;
    for (std::size_t k = 0; k < order_.size(); ++k) {
      const std::size_t r = At(order_[k]);
      const int shape = shapes_.shape_of[r];
      int& family =
          family_at[At(shapes_.shapes[At(shape)].first_place + shape + 1 + landmark_slot_[r])];
      if (family < 0) {
        family = static_cast<int>(sizes.size());
        sizes.push_back(0);
      }
      family_of[k] = family;
      ++sizes[At(family)];
    }
    members.resize(sizes.size());
    for (std::size_t family = 0; family < sizes.size(); ++family) {
      members[family].reserve(sizes[family]);
    }
    for (std::size_t k = 0; k < order_.size(); ++k) {
      members[At(family_of[k])].push_back(order_[k]);
    }
    for (std::vector<int>& residuals : members) {
      PlanFamily(std::move(residuals));
    }
  }

  void PlanFamily(std::vector<int> residuals) {
    GraphPlan::Family& family = plan_.families.emplace_back();
    family.shape = shapes_.ShapeOf(At(residuals.front()));
    family.variables.resize(residuals.size() * family.shape.slots.size());
    VariableId* variable = family.variables.data();
    for (const int r : residuals) {
      const ResidualBlockView& residual = view_.residuals[At(r)];
      const int* slots = view_.SlotsOf(residual);
      variable = std::transform(slots, slots + residual.num_slots, variable,
                                [&](int b) { return variable_of_[At(b)]; });
    }
    family.residuals = std::move(residuals);
  }

  const ProblemView& view_;
  const ShapeTable& shapes_;
  std::vector<VariableId> variable_of_;  // per parameter block
  VariableId first_landmark_ = 0;
  std::vector<int> landmark_slot_;  // per residual block
  std::vector<int> order_;          // residual blocks by landmark
  GraphPlan plan_;
};

}  // namespace

GraphPlan PlanGraph(const ProblemView& view, const ShapeTable& shapes,
                    LandmarkSelection landmarks) {
  return Planner(view, shapes, std::move(landmarks)).Run();
}

}  // namespace inceres::internal
