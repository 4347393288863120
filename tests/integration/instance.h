#pragma once

#include <functional>
#include <memory>
#include <vector>

#include <ceres/ordered_groups.h>
#include <ceres/problem.h>

#include "tools/problems/loss_spec.h"

namespace inceres::test {

/// A ceres::Problem with the memory of its parameter blocks: all of them lie in `x`, so that
/// copying `x` captures or restores the state of the whole problem.
struct Instance {
  std::vector<double> x;
  std::unique_ptr<ceres::Problem> problem;
  /// the blocks of the first group of an explicit ordering; may be empty
  std::vector<double*> landmarks;

  /// Landmarks in group 0, every other variable block in group 1; null if there are no landmarks.
  std::shared_ptr<ceres::ParameterBlockOrdering> LandmarksFirst() const;
};

/// Makes the same problem again, each time in memory of its own. Null, with a test failure or a
/// skip recorded, if the data cannot be had.
using Factory = std::function<std::unique_ptr<Instance>(const tools::LossSpec& loss)>;

/// The loss most problems are robustified with.
inline tools::LossSpec Huber(double scale) {
  return {tools::LossSpec::Kind::kHuber, scale};
}

}  // namespace inceres::test
