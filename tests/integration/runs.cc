#include "integration/runs.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <set>
#include <utility>

#include <ceres/ordered_groups.h>
#include <gtest/gtest.h>

namespace inceres::test {

namespace {

// Landmarks in group 0, every other variable block in group 1; null if there are no landmarks.
std::shared_ptr<ceres::ParameterBlockOrdering> LandmarksFirst(const Instance& instance) {
  if (instance.landmarks.empty()) {
    return nullptr;
  }
  const std::set<double*> first(instance.landmarks.begin(), instance.landmarks.end());
  std::vector<double*> blocks;
  instance.problem->GetParameterBlocks(&blocks);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (double* block : blocks) {
    if (!instance.problem->IsParameterBlockConstant(block)) {
      ordering->AddElementToGroup(block, first.count(block) > 0 ? 0 : 1);
    }
  }
  return ordering;
}

}  // namespace

ceres::Solver::Options DefaultOptions(ceres::TrustRegionStrategyType strategy) {
  ceres::Solver::Options options;
  options.trust_region_strategy_type = strategy;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 200;
  return options;
}

ceres::Solver::Options ZeroToleranceOptions(ceres::TrustRegionStrategyType strategy,
                                            int num_iterations) {
  ceres::Solver::Options options = DefaultOptions(strategy);
  options.max_num_iterations = num_iterations;
  options.function_tolerance = 0.0;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  return options;
}

ceres::Solver::Summary Solve(Who who, const Configuration& configuration,
                             ceres::Solver::Options options, Instance* instance) {
  options.linear_solver_type = configuration.linear_solver;
  options.dense_linear_algebra_library_type = configuration.dense;
  options.sparse_linear_algebra_library_type = configuration.sparse;
  // A new one each time: stock Ceres changes the caller's ordering.
  options.linear_solver_ordering =
      configuration.landmarks_first ? LandmarksFirst(*instance) : nullptr;
  ceres::Solver::Summary summary;
  if (who == Who::kStock) {
    ceres::Solve(options, instance->problem.get(), &summary);
  } else {
    SolveReport report;
    inceres::Solve(options, instance->problem.get(), &summary, {}, &report);
    EXPECT_FALSE(report.used_stock) << report.fallback_reason;
    if (!instance->landmarks.empty()) {
      EXPECT_EQ(report.num_landmarks, static_cast<int>(instance->landmarks.size()));
    }
  }
  return summary;
}

Solved Solve(Who who, const Configuration& configuration, const ceres::Solver::Options& options,
             const Factory& make, const tools::LossSpec& loss) {
  Solved run;
  const std::unique_ptr<Instance> instance = make(loss);
  if (instance == nullptr) {
    ADD_FAILURE() << "no problem to solve";
    return run;
  }
  run.summary = Solve(who, configuration, options, instance.get());
  run.x = std::move(instance->x);
  return run;
}

double RelativeDifference(double a, double b) {
  return a == b ? 0.0 : std::abs(a - b) / std::max(std::abs(a), std::abs(b));
}

std::string Printed(double difference) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1e", difference);
  return text;
}

double LargestDifference(const std::vector<double>& a, const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  double largest = 0.0;
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
    largest = std::max(largest, std::abs(a[k] - b[k]) / (1.0 + std::abs(a[k])));
  }
  return largest;
}

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
