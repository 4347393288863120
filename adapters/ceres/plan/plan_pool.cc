#include "adapters/ceres/plan/plan_pool.h"

#include <algorithm>
#include <utility>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/factor_shapes.h"

namespace inceres::internal {

PlanPool& PlanPool::Global() {
  static auto& kPool = *new PlanPool;
  return kPool;
}

std::shared_ptr<const GraphPlan> PlanPool::Get(const ProblemView& view, const OrderingView& ordering,
                                               ceres::LinearSolverType type) {
  const bool is_small = view.residuals.size() + view.slots.size() <= kMaxNumbers;
  if (is_small) {
    if (std::shared_ptr<const GraphPlan> plan = Find(view, ordering, type)) {
      return plan;
    }
  }
  const ShapeTable shapes = FindShapes(view);
  GraphPlan plan = PlanGraph(view, shapes, SelectLandmarks(view, ordering, shapes, type, AvailableBytes));
  if (!is_small || !plan.landmarks.obstacle.empty()) {  // there may be more memory another time
    return std::make_shared<const GraphPlan>(std::move(plan));
  }
  const auto entry = std::make_shared<const Entry>(Entry{ProblemStructure(view, ordering, type), std::move(plan)});
  Keep(entry);
  return {entry, &entry->plan};
}

std::shared_ptr<const GraphPlan> PlanPool::Find(const ProblemView& view, const OrderingView& ordering,
                                                ceres::LinearSolverType type) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = std::find_if(entries_.rbegin(), entries_.rend(),
                                  [&](const auto& entry) { return entry->structure.IsThatOf(view, ordering, type); });
  if (found == entries_.rend()) {
    return nullptr;
  }
  std::rotate(std::prev(found.base()), found.base(), entries_.end());
  return {entries_.back(), &entries_.back()->plan};
}

void PlanPool::Keep(std::shared_ptr<const Entry> entry) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (entries_.size() == kMaxPlans) {
    std::rotate(entries_.begin(), entries_.begin() + 1, entries_.end());
    entries_.back().swap(entry);  // the oldest is destroyed when the lock is free again
  } else {
    entries_.push_back(std::move(entry));
  }
}

void PlanPool::Clear() {
  std::vector<std::shared_ptr<const Entry>> forgotten;
  const std::lock_guard<std::mutex> lock(mutex_);
  forgotten.swap(entries_);
}

std::string ChoosePlan(ceres::LinearSolverType type, SolveInput* input) {
  if (input->view.reduced.num_parameter_blocks == 0) {
    return "";
  }
  input->plan = PlanPool::Global().Get(input->view, input->ordering, type);
  return input->plan->landmarks.obstacle;
}

}  // namespace inceres::internal
