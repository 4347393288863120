// The examples of docs/swap.md, compiled and run as they stand there.

#include <cmath>
#include <iostream>
#include <vector>

#include <ceres/ceres.h>
#include <gtest/gtest.h>

// clang-format off
// [quoted in docs/swap.md]
#include <inceres/ceres/solve.h>
// [end of quote]
// [quoted in docs/swap.md]
#include <inceres/ceres/session.h>
// [end of quote]

namespace {

void SwapTheSolver(const ceres::Solver::Options& options, ceres::Problem& problem,
                   double* final_cost) {
// [quoted in docs/swap.md]
ceres::Solver::Summary summary;
inceres::Solve(options, &problem, &summary);  // was: ceres::Solve(options, &problem, &summary)
// [end of quote]
  *final_cost = summary.final_cost;
}

bool AskForAReport(const ceres::Solver::Options& options, ceres::Problem& problem) {
  ceres::Solver::Summary summary;
// [quoted in docs/swap.md]
inceres::SolveOptions solve_options;
inceres::SolveReport report;
solve_options.strict = true;                            // an error instead of stock Ceres
solve_options.mode = inceres::SolveMode::kIncremental;  // or kExact, the default; or kStock
inceres::Solve(options, &problem, &summary, solve_options, &report);
// [end of quote]
  return summary.IsSolutionUsable() && !report.used_stock;
}

struct Odometry {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residual) const {
    residual[0] = b[0] - a[0] - step;
    return true;
  }
  double step;
};

struct Start {
  template <typename T>
  bool operator()(const T* a, T* residual) const {
    residual[0] = a[0] - 1.0;
    return true;
  }
};

// A chain of positions that grows by one at a time.
class Chain {
 public:
  Chain() : positions_(100, 0.0) {
    problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<Start, 1, 1>(new Start), nullptr,
                              positions_.data());
  }
  bool AddFrame() {
    double* last = positions_.data() + size_;
    problem_.AddResidualBlock(
        new ceres::AutoDiffCostFunction<Odometry, 1, 1, 1>(new Odometry{0.1 * size_}), nullptr,
        last, last + 1);
    return ++size_ < 20;
  }

  std::vector<double> positions_;
  int size_ = 0;
  ceres::Problem problem_;
};

void FollowAProblem(const ceres::Solver::Options& options, Chain& chain, int* num_kept) {
  ceres::Problem& problem = chain.problem_;
  const auto add_frame = [&] { return chain.AddFrame(); };
// [quoted in docs/swap.md]
inceres::CeresSession session;  // lives as long as the problem does
inceres::SolveReport report;
ceres::Solver::Summary summary;
while (add_frame()) {           // AddResidualBlock, RemoveParameterBlock, … as ever
  // Was: ceres::Solve(options, &problem, &summary).
  session.Solve(options, &problem, &summary, {}, &report);
  std::cout << report.changes.num_added_factors << " new, " << report.changes.num_kept_factors
            << " kept, " << report.update.num_relinearized_factors << " linearized\n";
}
// [end of quote]
  *num_kept = report.changes.num_kept_factors;
}
// clang-format on

ceres::Solver::Options Options() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.logging_type = ceres::SILENT;
  return options;
}

TEST(SwapExamples, SwapTheSolver) {
  Chain chain;
  chain.AddFrame();
  double final_cost = 1.0;
  SwapTheSolver(Options(), chain.problem_, &final_cost);
  EXPECT_LT(final_cost, 1e-12);
}

TEST(SwapExamples, AskForAReport) {
  Chain chain;
  chain.AddFrame();
  EXPECT_TRUE(AskForAReport(Options(), chain.problem_));
}

TEST(SwapExamples, FollowAProblem) {
  Chain chain;
  int num_kept = 0;
  FollowAProblem(Options(), chain, &num_kept);
  EXPECT_NEAR(chain.positions_[19], 1.0 + 0.1 * (18 * 19 / 2), 1e-6);
  EXPECT_GE(num_kept, 0);
}

}  // namespace
