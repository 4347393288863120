#include "adapters/ceres/dropin/src/registry.h"

#include <utility>

namespace inceres::internal {

// What an entry holds is destroyed outside the lock: a session is large.
void Registry::Add(const ceres::Problem* problem, ceres::EvaluationCallback* evaluation_callback) {
  auto entry = std::make_unique<KnownProblem>();
  entry->evaluation_callback = evaluation_callback;
  const std::lock_guard<std::mutex> lock(mutex_);
  problems_[problem].swap(entry);
}

void Registry::Move(const ceres::Problem* from, const ceres::Problem* to) {
  if (from == to) {
    return;
  }
  std::unique_ptr<KnownProblem> replaced;
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto moved = problems_.find(from);
  if (moved == problems_.end()) {
    const auto old = problems_.find(to);
    if (old != problems_.end()) {  // now a Problem that nothing is known of
      replaced = std::move(old->second);
      problems_.erase(old);
    }
    return;
  }
  std::unique_ptr<KnownProblem> entry = std::move(moved->second);
  problems_.erase(moved);
  replaced = std::exchange(problems_[to], std::move(entry));
}

void Registry::Remove(const ceres::Problem* problem) {
  std::unique_ptr<KnownProblem> removed;
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = problems_.find(problem);
  if (found != problems_.end()) {
    removed = std::move(found->second);
    problems_.erase(found);
  }
}

KnownProblem* Registry::Find(const ceres::Problem* problem) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = problems_.find(problem);
  return found == problems_.end() ? nullptr : found->second.get();
}

int Registry::size() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return static_cast<int>(problems_.size());
}

Registry& TheRegistry() {
  static Registry& registry = *new Registry;
  return registry;
}

}  // namespace inceres::internal
