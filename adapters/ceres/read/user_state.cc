#include "adapters/ceres/read/user_state.h"

#include <algorithm>
#include <cstddef>
#include <cstring>

namespace inceres::internal {

UserState::UserState(const ceres::Problem& problem) {
  std::vector<double*> all;
  problem.GetParameterBlocks(&all);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!problem.IsParameterBlockConstant(all[i])) {
      const int size = problem.ParameterBlockSize(all[i]);
      blocks_.push_back({all[i], static_cast<int>(i), size, num_values_});
      num_values_ += size;
    }
  }
}

UserState::UserState(const ProblemView& view) {
  for (std::size_t i = 0; i < view.blocks.size(); ++i) {
    const ParameterBlockView& block = view.blocks[i];
    if (block.reduced()) {
      blocks_.push_back({block.values, static_cast<int>(i), block.ambient_size, num_values_});
      num_values_ += block.ambient_size;
    }
  }
}

std::vector<double> UserState::Read() const {
  std::vector<double> values(static_cast<std::size_t>(num_values_));
  for (const Block& block : blocks_) {
    std::copy_n(block.values, block.size, values.data() + block.first);
  }
  return values;
}

void UserState::Write(const std::vector<double>& values) const {
  for (const Block& block : blocks_) {
    const std::size_t bytes = static_cast<std::size_t>(block.size) * sizeof(double);
    if (std::memcmp(block.values, values.data() + block.first, bytes) != 0) {
      std::memcpy(block.values, values.data() + block.first, bytes);
    }
  }
}

}  // namespace inceres::internal
