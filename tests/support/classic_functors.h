#pragma once

#include <cmath>

/// Classic test problems as users of Ceres write them: functors for Ceres's AutoDiff and for ours.
namespace inceres::test {

/// Powell's singular function, one term of four. Source: Powell, "An iterative method for finding
/// stationary values of a function of several variables", 1962.
struct PowellTerm {
  static constexpr double kStart[4] = {3.0, -1.0, 0.0, 1.0};
  static constexpr int kVariables[4][2] = {{0, 1}, {2, 3}, {1, 2}, {0, 3}};  ///< of each term

  template <typename T>
  bool operator()(const T* a, const T* b, T* residual) const {
    switch (term) {
      case 0:
        residual[0] = a[0] + 10.0 * b[0];
        return true;
      case 1:
        residual[0] = std::sqrt(5.0) * (a[0] - b[0]);
        return true;
      case 2:
        residual[0] = (a[0] - 2.0 * b[0]) * (a[0] - 2.0 * b[0]);
        return true;
      default:
        residual[0] = std::sqrt(10.0) * (a[0] - b[0]) * (a[0] - b[0]);
        return true;
    }
  }
  int term;
};

/// y − exp(m x + c).
struct ExponentialTerm {
  template <typename T>
  bool operator()(const T* m, const T* c, T* residual) const {
    using std::exp;
    residual[0] = y - exp(m[0] * x + c[0]);
    return true;
  }
  double x, y;
};

/// Rosenbrock's valley as least squares, (10 (y − x²), 1 − x).
struct RosenbrockTerm {
  template <typename T>
  bool operator()(const T* p, T* residuals) const {
    residuals[0] = 10.0 * (p[1] - p[0] * p[0]);
    residuals[1] = 1.0 - p[0];
    return true;
  }
};

}  // namespace inceres::test
