#include "integration/trace_comparison.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "integration/runs.h"

namespace inceres::test {

TraceDifference CompareTraces(const ceres::Solver::Summary& a, const ceres::Solver::Summary& b) {
  TraceDifference difference;
  for (std::size_t k = 0; k < std::min(a.iterations.size(), b.iterations.size()); ++k) {
    const ceres::IterationSummary& x = a.iterations[k];
    const ceres::IterationSummary& y = b.iterations[k];
    difference.same_decisions = difference.same_decisions && x.step_is_valid == y.step_is_valid &&
                                x.step_is_successful == y.step_is_successful;
    difference.cost = std::max(difference.cost, RelativeDifference(x.cost, y.cost));
    difference.radius = std::max(difference.radius,
                                 RelativeDifference(x.trust_region_radius, y.trust_region_radius));
  }
  return difference;
}

double SmallestChange(const ceres::Solver::Summary& summary) {
  double change = std::numeric_limits<double>::max();
  for (std::size_t k = 1; k < summary.iterations.size(); ++k) {
    change =
        std::min(change, std::abs(summary.iterations[k].cost_change) / summary.iterations[k].cost);
  }
  return change;
}

double DistanceFromThresholds(const ceres::Solver::Summary& summary) {
  std::vector<double> thresholds = {1e-3};
  if (summary.trust_region_strategy_type == ceres::DOGLEG) {
    thresholds.insert(thresholds.end(), {0.25, 0.75});
  }
  double distance = std::numeric_limits<double>::max();
  for (std::size_t k = 1; k < summary.iterations.size(); ++k) {
    for (const double threshold : thresholds) {
      distance = std::min(distance, std::abs(summary.iterations[k].relative_decrease - threshold));
    }
  }
  return distance;
}

}  // namespace inceres::test
