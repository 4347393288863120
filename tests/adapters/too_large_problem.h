#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "adapters/test_problems.h"

namespace inceres::testing {

/// A million unknowns, each coupled with each by one residual: no machine has the memory for a
/// factor of that, so inceres hands it over, but not before it has planned the solve. Stock
/// evaluates it once where no iteration is allowed.
struct TooLargeProblem {
  TooLargeProblem() {
    const std::vector<int> sizes(10, kSize);
    std::vector<double*> blocks;
    for (const int size : sizes) {
      blocks.push_back(test.Add(std::vector<double>(static_cast<std::size_t>(size), 1.0)));
    }
    const auto sum = [this](double const* const* x, double* residuals, double** jacobians) {
      ++num_calls;
      residuals[0] = x[0][0] + x[9][kSize - 1];
      for (int k = 0; jacobians != nullptr && k < 10; ++k) {
        if (jacobians[k] != nullptr) {
          std::fill_n(jacobians[k], kSize, 0.0);
          jacobians[k][0] = k == 0 ? 1.0 : 0.0;
          jacobians[k][kSize - 1] = k == 9 ? 1.0 : 0.0;
        }
      }
      return true;
    };
    test.problem.AddResidualBlock(new lambdas::Cost(1, sizes, sum), nullptr, blocks);
  }
  TooLargeProblem(const TooLargeProblem&) = delete;
  TooLargeProblem& operator=(const TooLargeProblem&) = delete;

  static ceres::Solver::Options Options() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = 0;
    options.logging_type = ceres::SILENT;
    return options;
  }

  static constexpr int kSize = 100000;
  TestProblem test;
  int num_calls = 0;
};

}  // namespace inceres::testing
