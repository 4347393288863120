#include "adapters/ceres/plan/graph_plan.h"

#include <algorithm>
#include <utility>

#include "adapters/ceres/read/index.h"
#include "src/base/counting_sort.h"
#include "src/base/executor.h"

namespace inceres::internal {
namespace {

constexpr int kGrain = 1 << 13;  // residual blocks a task, some nanoseconds each

class Planner {
 public:
  Planner(const ProblemView& view, const ShapeTable& shapes, LandmarkSelection landmarks,
          int num_threads)
      : view_(view), shapes_(shapes), variable_of_(view.blocks.size(), -1), threads_(num_threads) {
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
    const int count = static_cast<int>(view_.moving.size());
    landmark_slot_.resize(view_.residuals.size());
    UnwrittenVector<int> row_of(view_.moving.size());
    threads_.For(count, kGrain, [&](int begin, int end) {
      for (int k = begin; k < end; ++k) {
        const int r = view_.moving[At(k)];
        const ResidualBlockView& residual = view_.residuals[At(r)];
        const int slot =
            view_.FindSlot(residual, [this](int b) { return plan_.landmarks.Contains(b); });
        landmark_slot_[At(r)] = slot;
        row_of[At(k)] = slot < 0
                            ? num_landmarks
                            : variable_of_[At(view_.SlotsOf(residual)[slot])] - first_landmark_;
      }
    });
    if (std::is_sorted(row_of.begin(), row_of.end())) {
      order_.assign(view_.moving.begin(), view_.moving.end());
      return;
    }
    std::vector<int> begin;
    CountingSort(
        threads_, num_landmarks + 1, count, [&row_of](int k) { return row_of[At(k)]; }, &begin,
        &order_);
    std::transform(order_.begin(), order_.end(), order_.begin(),
                   [this](int k) { return view_.moving[At(k)]; });
  }

  // A family for each shape and slot of the landmark (slot -1: none): place numbers of the shapes,
  // one more for each shape.
  int PlaceOf(int residual) const {
    const int shape = shapes_.shape_of[At(residual)];
    return shapes_.shapes[At(shape)].first_place + shape + 1 + landmark_slot_[At(residual)];
  }

  void PlanFamilies() {
    if (order_.empty()) {
      return;
    }
    if (std::all_of(view_.moving.begin(), view_.moving.end(),
                    [this, place = PlaceOf(order_[0])](int r) { return PlaceOf(r) == place; })) {
      PlanFamily(std::move(order_));
      return;
    }
    std::vector<int> family_at(At(shapes_.num_places) + shapes_.shapes.size(), -1);
    std::vector<std::size_t> sizes;
    for (const int r : order_) {
      int& family = family_at[At(PlaceOf(r))];
      if (family < 0) {
        family = static_cast<int>(sizes.size());
        sizes.push_back(0);
      }
      ++sizes[At(family)];
    }
    std::vector<UnwrittenVector<int>> members(sizes.size());
    for (std::size_t family = 0; family < sizes.size(); ++family) {
      members[family].reserve(sizes[family]);
    }
    for (const int r : order_) {
      members[At(family_at[At(PlaceOf(r))])].push_back(r);
    }
    for (UnwrittenVector<int>& residuals : members) {
      PlanFamily(std::move(residuals));
    }
  }

  void PlanFamily(UnwrittenVector<int> residuals) {
    GraphPlan::Family& family = plan_.families.emplace_back();
    family.shape = shapes_.ShapeOf(At(residuals.front()));
    const std::size_t num_slots = family.shape.slots.size();
    family.variables.resize(residuals.size() * num_slots);
    threads_.For(static_cast<int>(residuals.size()), kGrain, [&](int begin, int end) {
      VariableId* variable = family.variables.data() + At(begin) * num_slots;
      for (int k = begin; k < end; ++k) {
        const ResidualBlockView& residual = view_.residuals[At(residuals[At(k)])];
        const int* const slots = view_.SlotsOf(residual);
        variable = std::transform(slots, slots + residual.num_slots, variable,
                                  [&](int b) { return variable_of_[At(b)]; });
      }
    });
    family.residuals = std::move(residuals);
  }

  const ProblemView& view_;
  const ShapeTable& shapes_;
  std::vector<VariableId> variable_of_;  // per parameter block
  VariableId first_landmark_ = 0;
  const Executor threads_;
  UnwrittenVector<int> landmark_slot_;  // per residual block that moves
  UnwrittenVector<int> order_;          // these by landmark
  GraphPlan plan_;
};

}  // namespace

GraphPlan PlanGraph(const ProblemView& view, const ShapeTable& shapes, LandmarkSelection landmarks,
                    int num_threads) {
  return Planner(view, shapes, std::move(landmarks), num_threads).Run();
}

}  // namespace inceres::internal
