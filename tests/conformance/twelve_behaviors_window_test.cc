// docs/ceres_contract.md, "Twelve behaviors of estimators", 9 to 12: weights, priors, toggled
// constants, threads.
#include <cmath>
#include <thread>

#include "conformance/support.h"

namespace conformance {
namespace {

Options Vio(int max_num_iterations = 30) {
  Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.function_tolerance = 1e-12;
  options.max_num_iterations = max_num_iterations;
  return options;
}

// r = A [x_0; x_1; …] − b, dense, of run-time size, with x_k measured from `origin`.
Cost* DensePrior(int num_residuals, const std::vector<int>& sizes, double origin, double diagonal) {
  return new Cost(
      num_residuals, sizes, [=](double const* const* p, double* residuals, double** jacobians) {
        std::fill_n(residuals, num_residuals, 0.0);
        int offset = 0;
        for (std::size_t k = 0; k < sizes.size(); ++k) {
          for (int c = 0; c < sizes[k]; ++c) {
            for (int r = 0; r < num_residuals; ++r) {
              const int column = offset + c;
              const double a =
                  0.3 * std::cos(1.0 + 3.0 * r + 1.7 * column) + (r == column ? diagonal : 0.0);
              residuals[r] += a * (p[k][c] - origin);
              if (jacobians != nullptr && jacobians[k] != nullptr) {
                jacobians[k][r * sizes[k] + c] = a;
              }
            }
          }
          offset += sizes[k];
        }
        return true;
      });
}

// Poses of size 6, inverse depths of size 1; each depth is seen by its anchor and two more.
struct Window : World {
  Window(int num_poses, int num_features, int seed) {
    for (int i = 0; i < num_poses; ++i) {
      poses.push_back(Add(std::vector<double>(6, 0.1 * i)));
    }
    for (int f = 0; f < num_features; ++f) {
      depths.push_back(Add({0.5}));
      const int anchor = f % (num_poses - 2);
      for (int k = 1; k < 3; ++k) {
        problem.AddResidualBlock(Coupled(2, {6, 6, 1}, seed + 10 * f + k), nullptr,
                                 poses[static_cast<std::size_t>(anchor)],
                                 poses[static_cast<std::size_t>(anchor + k)], depths.back());
      }
    }
  }
  std::vector<double*> poses;
  std::vector<double*> depths;
};

// XRSLAM's gauge prior has a square root of the information of 1e15; OKVIS zeroes the Jacobians of
// landmarks too close.
TEST(TwelveBehaviors, b09_huge_weights_and_singular_landmark_blocks) {
  for (const auto strategy : {ceres::DOGLEG, ceres::LEVENBERG_MARQUARDT}) {
    Window window(5, 40, 7);
    std::fill_n(window.poses[0], 6, 1.0 / 3.0);
    window.problem.AddResidualBlock(Target(std::vector<double>(6, 1.0 / 3.0), 1e15), nullptr,
                                    window.poses[0]);
    for (std::size_t i = 1; i < 5; ++i) {
      window.problem.AddResidualBlock(Target(std::vector<double>(6, 0.1), 3.0), nullptr,
                                      window.poses[i]);
    }
    std::vector<double*> singular;
    for (int f = 0; f < 6; ++f) {
      singular.push_back(window.Add({0.25}));
      for (std::size_t i = 0; i < 2; ++i) {
        auto* close =
            new Cost(2, {6, 1}, [](double const* const*, double* residuals, double** jacobians) {
              residuals[0] = residuals[1] = 0.1;
              for (int k = 0; k < 2 && jacobians != nullptr; ++k) {
                if (jacobians[k] != nullptr) {
                  std::fill_n(jacobians[k], k == 0 ? 12 : 2, 0.0);
                }
              }
              return true;
            });
        window.problem.AddResidualBlock(close, nullptr, window.poses[i], singular.back());
      }
    }
    Options options = Vio();
    options.trust_region_strategy_type = strategy;
    const Summary summary = Solve(options, &window.problem).summary;
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    for (int k = 0; k < 6; ++k) {
      EXPECT_NEAR(window.poses[0][k], 1.0 / 3.0, 1e-14);
    }
    for (const double* depth : singular) {
      EXPECT_EQ(depth[0], 0.25);
    }
    ExpectClose(summary.final_cost, 25.7513666823835, 1e-6);
  }
}

// VINS's prior over all poses, one speed-bias and the extrinsics: n = 75.
TEST(TwelveBehaviors, b10_dense_dynamic_prior) {
  Window window(10, 60, 3);
  double* speed_bias = window.Add(std::vector<double>(9, 0.2));
  double* extrinsic = window.Add(std::vector<double>(6, 0.3));
  std::vector<double*> blocks = window.poses;
  blocks.push_back(speed_bias);
  blocks.push_back(extrinsic);
  std::vector<int> sizes(10, 6);
  sizes.insert(sizes.end(), {9, 6});
  window.problem.AddResidualBlock(DensePrior(75, sizes, 0.15, 2.0), nullptr, blocks);
  const Summary summary = Solve(Vio(), &window.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
  EXPECT_EQ(summary.num_residuals, 75 + 60 * 4);
  ExpectClose(summary.final_cost, 24.9930265278, 1e-7);
  std::vector<double> gradient;
  double cost = 0.0;
  EXPECT_TRUE(window.problem.Evaluate(ceres::Problem::EvaluateOptions(), &cost, nullptr, &gradient,
                                      nullptr));
  ExpectClose(cost, summary.final_cost);
  for (const double entry : gradient) {
    EXPECT_NEAR(entry, 0.0, 1e-3);
  }
}

// OKVIS2 freezes all landmarks and all but one state, solves two iterations, and lets them go:
// twice for each frame.
TEST(TwelveBehaviors, b11_constants_toggled_per_solve) {
  Window window(6, 2000, 11);
  for (double* pose : window.poses) {
    window.problem.AddResidualBlock(Target(std::vector<double>(6, 0.1)), nullptr, pose);
  }
  double lowest = -1.0;
  for (int frame = 0; frame < 4; ++frame) {
    for (double* depth : window.depths) {
      window.problem.SetParameterBlockConstant(depth);
    }
    for (std::size_t i = 0; i < 5; ++i) {
      window.problem.SetParameterBlockConstant(window.poses[i]);
    }
    window.poses[5][0] += 0.5;
    const auto before = window.blocks;
    const Summary one = Solve(Vio(2), &window.problem).summary;
    EXPECT_TRUE(one.IsSolutionUsable());
    EXPECT_EQ(one.num_parameter_blocks_reduced, 1);
    EXPECT_EQ(one.num_parameter_blocks, 2006);
    EXPECT_GT(one.fixed_cost, 0.0);
    EXPECT_LT(one.final_cost, one.initial_cost);
    for (std::size_t b = 0; b < before.size(); ++b) {
      EXPECT_EQ(before[b] == window.blocks[b], b != 5) << "block " << b;
    }
    for (double* depth : window.depths) {
      window.problem.SetParameterBlockVariable(depth);
    }
    for (std::size_t i = 0; i < 5; ++i) {
      window.problem.SetParameterBlockVariable(window.poses[i]);
    }
    const Summary all = Solve(Vio(), &window.problem).summary;
    EXPECT_TRUE(all.IsSolutionUsable());
    EXPECT_EQ(all.num_parameter_blocks_reduced, 2006);
    EXPECT_EQ(all.fixed_cost, 0.0);
    ExpectClose(all.initial_cost, one.final_cost, 1e-9);
    lowest = all.final_cost;
    ExpectClose(lowest, 1028.83517054333, 1e-6);
  }
}

// A map that lives on in one thread, full problems made anew in others: each ends where it ends
// alone.
TEST(TwelveBehaviors, b12_concurrent_solves_on_different_problems) {
  const auto live = [](double* cost) {
    Window map(6, 60, 5);
    for (double* pose : map.poses) {
      map.problem.AddResidualBlock(Target(std::vector<double>(6, 0.1)), nullptr, pose);
    }
    for (int frame = 0; frame < 15; ++frame) {
      map.poses[static_cast<std::size_t>(frame % 6)][0] += 0.1;
      Summary summary;
      ceres::Solve(Vio(), &map.problem, &summary);
      *cost = summary.IsSolutionUsable() ? summary.final_cost : -1.0;
    }
  };
  const auto rebuild = [](double* cost) {
    for (int frame = 0; frame < 15; ++frame) {
      Bundle bundle(4, 30);
      Summary summary;
      Options options = Vio();
      options.num_threads = 2;
      ceres::Solve(options, &bundle.problem, &summary);
      *cost = summary.IsSolutionUsable() ? summary.final_cost : -1.0;
    }
  };
  double costs[4] = {};
  std::vector<std::thread> threads;
  for (int k = 0; k < 4; ++k) {
    threads.emplace_back(k % 2 == 0 ? std::function<void(double*)>(live) : rebuild, &costs[k]);
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (int k = 0; k < 4; ++k) {
    ExpectClose(costs[k], k % 2 == 0 ? 22.4365003336753 : 21.3838611305685, 1e-6);
  }
}

}  // namespace
}  // namespace conformance
