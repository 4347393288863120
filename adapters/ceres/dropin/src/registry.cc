#include "adapters/ceres/dropin/src/registry.h"

#include <utility>

namespace inceres::internal {

// Of a Problem that nothing is known of nothing is known afterwards, where it is now.
void Registry::Move(const ceres::Problem* from, const ceres::Problem* to) {
  if (from == to) {
    return;
  }
  std::unique_ptr<KnownProblem> entry = Take(from);
  const std::unique_ptr<KnownProblem> replaced = Take(to);
  if (entry != nullptr) {
    Add(to, std::move(entry));
  }
}

Registry& TheRegistry() {
  static Registry& registry = *new Registry;
  return registry;
}

}  // namespace inceres::internal
