// Solvers with inceres::AutoDiffCostFunction: stock Ceres's, ours.

#include <memory>
#include <vector>

#include <ceres/autodiff_cost_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include "autodiff/gallery.h"
#include "inceres/ceres/autodiff_cost_function.h"
#include "inceres/ceres/solve.h"
#include "support/random_values.h"

namespace inceres {
namespace {

// A small bundle with noise, its values where Solve finds them.
template <template <typename, int, int...> class Cost>
struct Bundle {
  Bundle() {
    test::Random random(31);
    for (std::size_t c = 0; c < kCameras; ++c) {
      cameras.push_back({0.1 * random.Unit(), 0.1 * random.Unit(), 0.1 * random.Unit(),
                         random.Unit(), random.Unit(), random.Unit() - 8.0, 500.0, 0.0, 0.0});
    }
    for (std::size_t p = 0; p < kPoints; ++p) {
      points.push_back({random.Unit(), random.Unit(), random.Unit()});
    }
    for (auto& camera : cameras) {
      for (auto& point : points) {
        auto* functor = new test::SnavelyFunctor{0.0, 0.0};
        double residual[2];
        (*functor)(camera.data(), point.data(), residual);
        functor->x = residual[0] + random.Unit();
        functor->y = residual[1] + random.Unit();
        problem.AddResidualBlock(new Cost<test::SnavelyFunctor, 2, 9, 3>(functor), nullptr,
                                 camera.data(), point.data());
      }
    }
    for (auto& point : points) {
      point[0] += 0.05 * random.Unit();
    }
  }
  static constexpr std::size_t kCameras = 4, kPoints = 30;
  std::vector<std::vector<double>> cameras, points;
  ceres::Problem problem;
};

template <typename T, int kResiduals, int... Ns>
using StockCost = ceres::AutoDiffCostFunction<T, kResiduals, Ns...>;

ceres::Solver::Options BundleOptions() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 20;
  options.logging_type = ceres::SILENT;
  return options;
}

// The same cost after each iteration.
void ExpectSameIterations(const ceres::Solver::Summary& ours, const ceres::Solver::Summary& stock) {
  EXPECT_EQ(ours.termination_type, stock.termination_type);
  EXPECT_LT(ours.final_cost, 0.5 * ours.initial_cost);
  ASSERT_EQ(ours.iterations.size(), stock.iterations.size());
  ASSERT_GT(ours.iterations.size(), 3U);
  for (std::size_t k = 0; k < ours.iterations.size(); ++k) {
    EXPECT_NEAR(ours.iterations[k].cost, stock.iterations[k].cost, 1e-9 * stock.initial_cost);
  }
}

TEST(AutoDiffSolve, StockCeresTakesTheSameSteps) {
  Bundle<AutoDiffCostFunction> ours;
  Bundle<StockCost> stock;
  ceres::Solver::Summary our_summary, stock_summary;
  ceres::Solve(BundleOptions(), &ours.problem, &our_summary);
  ceres::Solve(BundleOptions(), &stock.problem, &stock_summary);
  ExpectSameIterations(our_summary, stock_summary);
}

TEST(AutoDiffSolve, OursTakesTheSameSteps) {
  Bundle<AutoDiffCostFunction> ours;
  Bundle<StockCost> stock;
  ceres::Solver::Summary our_summary, stock_summary;
  inceres::Solve(BundleOptions(), &ours.problem, &our_summary);
  inceres::Solve(BundleOptions(), &stock.problem, &stock_summary);
  ExpectSameIterations(our_summary, stock_summary);
}

}  // namespace
}  // namespace inceres
