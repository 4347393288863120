#pragma once

#include <memory>
#include <unordered_map>
#include <vector>

#include <ceres/loss_function.h>

#include "inceres/problem/loss.h"

namespace inceres::internal {

/// One adapter for each of the user's losses, over several solves. A loss that comes back at the same address keeps its adapter
/// only if it still gives the same values at 25 arguments from 4⁻¹² to 4¹²: a factor whose adapter is not the one Get returns has
/// another loss.
class LossTable {
 public:
  /// Begins a solve: each loss is looked at again.
  void Begin() {
    ++solve_;
    last_loss_ = nullptr;
  }
  /// The adapter of a loss of this solve; null for null. Cost: one hash lookup where the loss differs from the one before.
  const std::shared_ptr<const Loss>& Get(const ceres::LossFunction* loss);
  /// Ends a solve: what was not asked for is forgotten, for it may be gone.
  void End();
  void Forget(const ceres::LossFunction* loss) { entries_.erase(loss); }

 private:
  struct Entry {
    std::shared_ptr<const Loss> adapter;
    std::vector<double> fingerprint;
    int solve = -1;
  };

  std::unordered_map<const ceres::LossFunction*, Entry> entries_;
  int solve_ = 0;
  const ceres::LossFunction* last_loss_ = nullptr;
  const std::shared_ptr<const Loss>* last_ = nullptr;
  std::shared_ptr<const Loss> null_;
};

}  // namespace inceres::internal
