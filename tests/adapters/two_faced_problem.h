#pragma once

#include <functional>

#include "adapters/test_problems.h"

namespace inceres::testing {

/// Powell's function beside one number that climbs from 1 to 3 under r = x² − 9, about which the
/// hook decides: it is told which solve this is, from 1 (each begins with a Jacobian at the start),
/// and how many cost-only calls it has made, and may change the residual or refuse.
struct TwoFacedProblem {
  using Hook = std::function<bool(int solve, int call, double* residual)>;

  explicit TwoFacedProblem(Hook face) : test(MakePowell()), hook(std::move(face)) {
    block = test->Add({kStart});
    const auto climb = [this](double const* const* x, double* residuals, double** jacobians) {
      residuals[0] = x[0][0] * x[0][0] - 9.0;
      if (jacobians != nullptr && jacobians[0] != nullptr) {
        jacobians[0][0] = 2.0 * x[0][0];
        if (x[0][0] == kStart) {
          ++solve;
          call = 0;
        }
      } else {
        ++call;
      }
      return hook == nullptr || hook(solve, call, residuals);
    };
    test->problem.AddResidualBlock(new lambdas::Cost(1, {1}, climb), nullptr, block);
  }

  static constexpr double kStart = 1.0;
  std::unique_ptr<TestProblem> test;
  Hook hook;
  double* block = nullptr;
  int solve = 0;
  int call = 0;
};

}  // namespace inceres::testing
