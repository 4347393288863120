#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "inceres/problem/ambient_family.h"
#include "inceres/problem/factor_graph.h"

namespace inceres::test {

// The point of a closed quadratic B-spline at t, less an observation. Slots: t, then all control
// points, of which three count.
class CurveFamily final : public AmbientFamily<CurveFamily> {
 public:
  explicit CurveFamily(int num_control_points) : AmbientFamily(2, Slots(num_control_points)) {}

  void Add(double x, double y) { observations_.push_back({x, y}); }
  int size() const override { return static_cast<int>(observations_.size()); }
  const char* Name() const override { return "curve"; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const int n = num_slots() - 1;
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
      residuals[d] = -(d == 0 ? observations_[static_cast<std::size_t>(i)].x
                              : observations_[static_cast<std::size_t>(i)].y);
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

 private:
  struct Observation {
    double x, y;
  };
  static std::vector<Slot> Slots(int num_control_points) {
    std::vector<Slot> slots(static_cast<std::size_t>(num_control_points) + 1, Slot{2, 2});
    slots[0] = {1, 1};
    return slots;
  }
  std::vector<Observation> observations_;
};

// Neighbors are near each other.
class SpringFamily final : public AmbientFamily<SpringFamily> {
 public:
  explicit SpringFamily(int num_springs)
      : AmbientFamily(2, {{2, 2}, {2, 2}}), num_springs_(num_springs) {}
  int size() const override { return num_springs_; }
  const char* Name() const override { return "spring"; }
  bool EvaluateOne(int, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    for (int d = 0; d < 2; ++d) {
      residuals[d] = 0.05 * (parameters[0][d] - parameters[1][d]);
    }
    for (int s = 0; jacobians != nullptr && s < 2; ++s) {
      if (jacobians[s] != nullptr) {
        std::fill_n(jacobians[s], 4, 0.0);
        jacobians[s][0] = jacobians[s][3] = s == 0 ? 0.05 : -0.05;
      }
    }
    return true;
  }

 private:
  int num_springs_;
};

constexpr int kControlPoints = 60;
constexpr int kObservations = 250;

inline FactorGraph MakeCurve(unsigned seed, const std::shared_ptr<const Loss>& loss = nullptr,
                             bool some_constant = false) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  FactorGraph graph;
  std::vector<VariableId> slots = {0};
  for (int k = 0; k < kControlPoints; ++k) {
    const double angle = 2.0 * M_PI * k / kControlPoints;
    const double point[2] = {3.0 * std::cos(angle), 3.0 * std::sin(angle)};
    slots.push_back(graph.AddVariable(point, 2, Role::kFrame));
    if (some_constant && k % 7 == 0) {
      graph.SetConstant(slots.back(), true);
    }
  }
  auto curve = std::make_shared<CurveFamily>(kControlPoints);
  const FamilyId curve_id = graph.AddFamily(curve);
  const FamilyId spring_id = graph.AddFamily(std::make_shared<SpringFamily>(kControlPoints));
  for (int i = 0; i < kObservations; ++i) {
    const double angle = 2.0 * M_PI * i / kObservations;
    const double t = kControlPoints * (angle / (2.0 * M_PI)) + 0.6 * normal(random);
    slots[0] = graph.AddVariable(&t, 1, Role::kFrame);
    curve->Add(5.0 * std::cos(angle) + 0.02 * normal(random),
               2.0 * std::sin(angle) + 0.02 * normal(random));
    graph.Connect(curve_id, slots.data(), loss);
  }
  for (int k = 0; k < kControlPoints; ++k) {
    const VariableId pair[2] = {slots[static_cast<std::size_t>(k) + 1],
                                slots[static_cast<std::size_t>((k + 1) % kControlPoints) + 1]};
    graph.Connect(spring_id, pair);
  }
  return graph;
}

}  // namespace inceres::test
