#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <vector>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// Memory of the views of small problems, for the next ones: nothing of what was in it is read. Guarded: concurrent solves, and
/// one within another, have a view each.
class ViewPool {
 public:
  static constexpr std::size_t kMaxIdle = 4;

  /// The process's. Never destroyed, as SolverPool's.
  static ViewPool& Global();

  /// An empty view.
  std::unique_ptr<ProblemView> Take();
  void GiveBack(std::unique_ptr<ProblemView> view);
  void Clear();

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<ProblemView>> idle_;
};

}  // namespace inceres::internal
