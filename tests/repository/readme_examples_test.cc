// The README's examples, compiled and run as they stand there.

#include <cmath>
#include <iostream>
#include <memory>

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include "inceres/ceres/solve.h"
#include "inceres/factors/bal_reprojection.h"
#include "inceres/graph/losses.h"
#include "inceres/solver/solver.h"

namespace {

struct Distance {
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    residual[0] = x[0] - 3.0;
    return true;
  }
};

// clang-format off
void SwapTheSolver(const ceres::Solver::Options& options, ceres::Problem& problem, double* final_cost) {
// [quoted in README.md]
ceres::Solver::Summary summary;
inceres::Solve(options, &problem, &summary);  // was: ceres::Solve(options, &problem, &summary);
// [end of quote]
  *final_cost = summary.final_cost;
}

void AskForAReport(const ceres::Solver::Options& options, ceres::Problem& problem, bool* solved) {
  ceres::Solver::Summary summary;
// [quoted in README.md]
inceres::SolveReport report;
report.strict = true;  // rather an error than stock Ceres
inceres::Solve(options, &problem, &summary, &report);
if (!report.fallback_reason.empty()) {
  std::cerr << report.fallback_reason << '\n';
}
// [end of quote]
  *solved = report.fallback_reason.empty() && summary.IsSolutionUsable();
}

inceres::Summary SolveWithTheCore(const double* camera_values, const double* point_values, double x, double y) {
// [quoted in README.md]
inceres::FactorGraph graph;
auto reprojections = std::make_shared<inceres::BalReprojectionFamily>();
const inceres::FamilyId family = graph.AddFamily(reprojections);
const inceres::VariableId camera = graph.AddVariable(camera_values, 9, inceres::Role::kFrame);
const inceres::VariableId point = graph.AddVariable(point_values, 3, inceres::Role::kLandmark);
graph.AddFactor(family, *reprojections, {x, y}, {camera, point}, std::make_shared<inceres::HuberLoss>(1.0));
const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
// [end of quote]
  return summary;
}
// clang-format on

TEST(ReadmeExamples, SwapTheSolver) {
  double x = 0.0;
  ceres::Problem problem;
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Distance, 1, 1>(new Distance), nullptr, &x);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  double final_cost = 1.0;
  SwapTheSolver(options, problem, &final_cost);
  EXPECT_LT(final_cost, 1e-8);
  EXPECT_NEAR(x, 3.0, 1e-3);
}

TEST(ReadmeExamples, AskForAReport) {
  double x = 0.0;
  ceres::Problem problem;
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Distance, 1, 1>(new Distance), nullptr, &x);
  bool solved = false;
  AskForAReport(ceres::Solver::Options(), problem, &solved);
  EXPECT_TRUE(solved);

  ceres::Solver::Options line_search;
  line_search.minimizer_type = ceres::LINE_SEARCH;
  AskForAReport(line_search, problem, &solved);
  EXPECT_FALSE(solved);
}

TEST(ReadmeExamples, SolveWithTheCore) {
  const double camera[9] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 500.0, 0.0, 0.0};
  const double point[3] = {0.1, 0.2, -5.0};
  const inceres::Summary summary = SolveWithTheCore(camera, point, 11.0, 19.0);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_LT(summary.final_cost, 1e-6 * summary.initial_cost);
}

}  // namespace
