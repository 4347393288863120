#include "tools/sim/simulated_bal.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "tools/sim/scene_noise.h"

namespace inceres {

void SimulatedBal::SortByCamera() {
  const std::vector<BalObservation> before = std::move(problem.observations);
  std::vector<int> order(before.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return before[a].camera < before[b].camera; });
  std::vector<int> outliers_before = std::move(outliers);
  problem.observations.clear();
  outliers.clear();
  for (int k = 0; k < static_cast<int>(order.size()); ++k) {
    problem.observations.push_back(before[order[k]]);
    if (std::binary_search(outliers_before.begin(), outliers_before.end(), order[k])) {
      outliers.push_back(k);
    }
  }
}

void SimulatedBal::BecomeTruth() {
  problem.cameras = std::move(true_cameras);
  problem.points = std::move(true_points);
  internal::ProjectAll(&problem);
}

double SimulatedBal::RmsAtTruth() {
  problem.cameras.swap(true_cameras);
  problem.points.swap(true_points);
  const double rms = ReprojectionRms(problem);
  problem.cameras.swap(true_cameras);
  problem.points.swap(true_points);
  return rms;
}

}  // namespace inceres
