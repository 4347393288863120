#include "adapters/ceres/plan/view_pool.h"

#include <utility>

namespace inceres::internal {

ViewPool& ViewPool::Global() {
  static auto& kPool = *new ViewPool;
  return kPool;
}

std::unique_ptr<ProblemView> ViewPool::Take() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (idle_.empty()) {
    return std::make_unique<ProblemView>();
  }
  std::unique_ptr<ProblemView> view = std::move(idle_.back());
  idle_.pop_back();
  return view;
}

void ViewPool::GiveBack(std::unique_ptr<ProblemView> view) {
  if (!view->IsSmall()) {
    return;
  }
  view->Clear();
  const std::lock_guard<std::mutex> lock(mutex_);
  if (idle_.size() < kMaxIdle) {
    idle_.push_back(std::move(view));
  }
}

void ViewPool::Clear() {
  std::vector<std::unique_ptr<ProblemView>> forgotten;
  const std::lock_guard<std::mutex> lock(mutex_);
  forgotten.swap(idle_);
}

}  // namespace inceres::internal
