#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

/// A closed curve fitted to points: residual blocks that touch all its control points, of which
/// three count, and others from step to step.
namespace inceres::test {

/// The point of a closed quadratic B-spline at t, less an observation. Blocks: t, then all control
/// points.
inline bool EvaluateClosedCurve(int num_control_points, const std::array<double, 2>& observed,
                                const double* const* parameters, double* residuals,
                                double** jacobians) {
  const int n = num_control_points;
  const double t = parameters[0][0] - n * std::floor(parameters[0][0] / n);
  const int first = std::min(static_cast<int>(t), n - 1);
  const double u = t - first;
  const double weights[3] = {0.5 * (1.0 - u) * (1.0 - u), 0.5 + u * (1.0 - u), 0.5 * u * u};
  const double slopes[3] = {u - 1.0, 1.0 - 2.0 * u, u};
  for (int k = 1; jacobians != nullptr && k <= n; ++k) {
    if (jacobians[k] != nullptr) {
      std::fill_n(jacobians[k], 4, 0.0);
    }
  }
  for (int d = 0; d < 2; ++d) {
    double tangent = 0.0;
    residuals[d] = -observed[static_cast<std::size_t>(d)];
    for (int k = 0; k < 3; ++k) {
      const int slot = 1 + (first + k) % n;
      residuals[d] += weights[k] * parameters[slot][d];
      tangent += slopes[k] * parameters[slot][d];
      if (jacobians != nullptr && jacobians[slot] != nullptr) {
        jacobians[slot][3 * d] = weights[k];
      }
    }
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][d] = tangent;
    }
  }
  return true;
}

/// Neighbors are near each other: an AutoDiff functor.
struct Spring {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residuals) const {
    residuals[0] = 0.05 * (a[0] - b[0]);
    residuals[1] = 0.05 * (a[1] - b[1]);
    return true;
  }
};

/// Control points on a circle and noisy points of an ellipse, each with a first guess of its t.
struct ClosedCurveScene {
  struct Observation {
    double t;
    std::array<double, 2> point;
  };

  ClosedCurveScene(unsigned seed, int num_control_points, int num_observations) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    for (int k = 0; k < num_control_points; ++k) {
      const double angle = 2.0 * M_PI * k / num_control_points;
      control_points.push_back({3.0 * std::cos(angle), 3.0 * std::sin(angle)});
    }
    for (int i = 0; i < num_observations; ++i) {
      const double turn = static_cast<double>(i) / num_observations;
      const double angle = 2.0 * M_PI * turn;
      observations.push_back({num_control_points * turn + 0.6 * normal(random),
                              {5.0 * std::cos(angle) + 0.02 * normal(random),
                               2.0 * std::sin(angle) + 0.02 * normal(random)}});
    }
  }

  std::vector<std::array<double, 2>> control_points;
  std::vector<Observation> observations;
};

}  // namespace inceres::test
