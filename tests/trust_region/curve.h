#pragma once

#include <memory>
#include <vector>

#include "inceres/autodiff/autodiff_family.h"
#include "inceres/problem/factor_graph.h"
#include "support/closed_curve.h"
#include "support/test_families.h"

namespace inceres::test {

constexpr int kControlPoints = 60;
constexpr int kObservations = 250;

inline FactorGraph MakeCurve(unsigned seed, const std::shared_ptr<const Loss>& loss = nullptr,
                             bool some_constant = false) {
  const ClosedCurveScene scene(seed, kControlPoints, kObservations);
  FactorGraph graph;
  std::vector<VariableId> slots = {0};
  std::vector<FactorFamily::Slot> sizes = {{1, 1}};
  for (std::size_t k = 0; k < scene.control_points.size(); ++k) {
    slots.push_back(graph.AddVariable(scene.control_points[k].data(), 2, Role::kFrame));
    sizes.push_back({2, 2});
    graph.SetConstant(slots.back(), some_constant && k % 7 == 0);
  }
  const auto curve = graph.AddFamily(std::make_shared<FunctionFamily>(
      2, sizes, [observations = scene.observations](int i, const auto& x, double* r, double** J) {
        return EvaluateClosedCurve(kControlPoints, observations[static_cast<std::size_t>(i)].point,
                                   x, r, J);
      }));
  const auto springs = graph.AddFamily(std::make_shared<AutoDiffFamily<Spring, 2, 2, 2>>("spring"));
  for (const auto& observation : scene.observations) {
    slots[0] = graph.AddVariable(&observation.t, 1, Role::kFrame);
    graph.AddFactor(curve, 0, slots, loss);
  }
  for (std::size_t k = 0; k < scene.control_points.size(); ++k) {
    graph.AddFactor(springs, {}, {slots[k + 1], slots[(k + 1) % scene.control_points.size() + 1]});
  }
  return graph;
}

}  // namespace inceres::test
