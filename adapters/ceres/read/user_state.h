#pragma once

#include <vector>

#include <ceres/problem.h>

namespace inceres::internal {

/// The caller's memory of all parameter blocks that a solve may write: those not constant. Constant ones are never written, for
/// they may lie in read-only memory or belong to a solve in another thread too.
class UserState {
 public:
  struct Block {
    double* values;
    int index;  ///< among Problem::GetParameterBlocks
    int size;
    int first;  ///< in the vectors of values
  };

  explicit UserState(const ceres::Problem& problem);

  std::vector<double> Read() const;
  /// Leaves alone what is the same already.
  void Write(const std::vector<double>& values) const;
  const std::vector<Block>& blocks() const { return blocks_; }

 private:
  std::vector<Block> blocks_;
  int num_values_ = 0;
};

}  // namespace inceres::internal
