// The README's examples, compiled and run as they stand there.

#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <vector>

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include "inceres/ceres/cost_family.h"
#include "inceres/ceres/solve.h"
#include "inceres/factors/bal_reprojection.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
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
void SwapTheSolver(const ceres::Solver::Options& options, ceres::Problem& problem,
                   double* final_cost) {
// [quoted in README.md]
ceres::Solver::Summary summary;
inceres::Solve(options, &problem, &summary);  // was: ceres::Solve(options, &problem, &summary);
// [end of quote]
  *final_cost = summary.final_cost;
}

void AskForAReport(const ceres::Solver::Options& options, ceres::Problem& problem, bool* solved) {
  ceres::Solver::Summary summary;
// [quoted in README.md]
inceres::SolveOptions solve_options;
inceres::SolveReport report;
solve_options.strict = true;  // rather an error than stock Ceres
inceres::Solve(options, &problem, &summary, solve_options, &report);
if (!report.fallback_reason.empty()) {
  std::cerr << report.fallback_reason << '\n';
}
// [end of quote]
  *solved = report.fallback_reason.empty() && summary.IsSolutionUsable();
}

inceres::Summary SolveWithTheCore(const double* camera_values, const double* point_values,
                                  double x, double y) {
// [quoted in README.md]
inceres::FactorGraph graph;
const auto reprojections = graph.AddFamily(std::make_shared<inceres::BalReprojectionFamily>());
const inceres::VariableId camera = graph.AddVariable(camera_values, 9, inceres::Role::kFrame);
const inceres::VariableId point = graph.AddVariable(point_values, 3, inceres::Role::kLandmark);
graph.AddFactor(reprojections, {x, y}, {camera, point}, std::make_shared<inceres::HuberLoss>(1.0));
const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
// [end of quote]
  return summary;
}

// [quoted in README.md]
struct RangeError {  // as for Ceres: how far X is from the pose's center, against what was measured
  double range;
  template <typename T>
  bool operator()(const T* pose, const T* X, T* residual) const {
    const T d[3] = {X[0] - pose[0], X[1] - pose[1], X[2] - pose[2]};
    using std::sqrt;
    residual[0] = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) - range;
    return true;
  }
};
// [end of quote]

// [quoted in README.md]
// A barometer: 10 (p_z - height).
class HeightFamily : public inceres::AmbientFamily<HeightFamily> {
 public:
  using Measurement = double;
  // One residual; ambient and tangent size of each variable.
  HeightFamily() : AmbientFamily(1, {{7, 6}}) {}

  void Add(double height) { heights_.push_back(height); }
  void Place(int index, double height) { PlaceIn(&heights_, index, height); }  // for edits
  int size() const override { return static_cast<int>(heights_.size()); }
  const char* Name() const override { return "height"; }

  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    residuals[0] = 10.0 * (parameters[0][2] - heights_[static_cast<std::size_t>(i)]);
    if (jacobians != nullptr && jacobians[0] != nullptr) {  // null: cost only, or a constant
      std::fill_n(jacobians[0], 7, 0.0);
      jacobians[0][2] = 10.0;
    }
    return true;
  }

 private:
  std::vector<double> heights_;
};
// [end of quote]

void AddOwnFactors(inceres::VariableId pose, inceres::VariableId beacon,
                   inceres::FactorGraph& graph) {
// [quoted in README.md]
using Slots = std::vector<inceres::FactorFamily::Slot>;
const auto ranges =
    graph.AddFamily(std::make_shared<inceres::CeresCostFamily>(1, Slots{{7, 6}, {3, 3}}));
const auto heights = graph.AddFamily(std::make_shared<HeightFamily>());
auto cost =
    std::make_shared<ceres::AutoDiffCostFunction<RangeError, 1, 7, 3>>(new RangeError{5.0});
graph.AddFactor(ranges, cost, {pose, beacon});
graph.AddFactor(heights, 1.5, {pose});
// [end of quote]
}
// clang-format on

TEST(ReadmeExamples, SwapTheSolver) {
  double x = 0.0;
  ceres::Problem problem;
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Distance, 1, 1>(new Distance), nullptr,
                           &x);
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
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Distance, 1, 1>(new Distance), nullptr,
                           &x);
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

TEST(ReadmeExamples, OwnFactors) {
  inceres::FactorGraph graph;
  const double start[7] = {0.5, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0};
  const double place[3] = {4.0, 0.0, 1.5};
  const inceres::VariableId pose =
      graph.AddVariable(start, 7, inceres::Role::kFrame, std::make_shared<inceres::PoseManifold>());
  const inceres::VariableId beacon = graph.AddVariable(place, 3, inceres::Role::kLandmark);
  graph.SetConstant(beacon, true);
  AddOwnFactors(pose, beacon, graph);
  const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_LT(summary.final_cost, 1e-10 * summary.initial_cost);
  const double* p = graph.Values(pose);
  EXPECT_NEAR(p[2], 1.5, 1e-6);
  EXPECT_NEAR(std::hypot(p[0] - 4.0, p[1], p[2] - 1.5), 5.0, 1e-6);
}

}  // namespace
