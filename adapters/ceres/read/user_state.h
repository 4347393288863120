#pragma once

#include <utility>
#include <vector>

#include <ceres/problem.h>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// The caller's memory of all parameter blocks that a solve may write: those not constant. Constant
/// ones are never written, for they may lie in read-only memory or belong to a solve in another
/// thread too.
class UserState {
 public:
  struct Block {
    double* values;
    int index;  ///< among Problem::GetParameterBlocks
    int size;
    int first;  ///< in the vectors of values
  };

  explicit UserState(const ceres::Problem& problem);
  /// Of the blocks that a solver moves; `index` is among the view's.
  explicit UserState(const ProblemView& view);

  std::vector<double> Read() const;
  /// Leaves alone what is the same already.
  void Write(const std::vector<double>& values) const;
  const std::vector<Block>& blocks() const { return blocks_; }

 private:
  std::vector<Block> blocks_;
  int num_values_ = 0;
};

/// What is in the user's memory. It is there again when this is gone, by an exception out of user
/// code too, unless Keep was called.
class StartValues {
 public:
  explicit StartValues(UserState layout) : layout_(std::move(layout)), values_(layout_.Read()) {}
  /// Of the blocks that a solver moves.
  explicit StartValues(const ProblemView& view) : StartValues(UserState(view)) {}
  ~StartValues() {
    if (armed_) {
      PutBack();
    }
  }
  StartValues(const StartValues&) = delete;
  StartValues& operator=(const StartValues&) = delete;
  void Keep() { armed_ = false; }
  /// Writes them into the user's memory, now.
  void PutBack() const { layout_.Write(values_); }

 private:
  const UserState layout_;
  const std::vector<double> values_;
  bool armed_ = true;
};

}  // namespace inceres::internal
