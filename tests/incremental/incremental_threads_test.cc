// The same bits for any number of threads, Update after Update.

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "incremental/incremental_bundle.h"

namespace inceres {
namespace {

using test::IncrementalBundle;

struct Trace {
  std::vector<double> costs;
  std::vector<std::vector<double>> values;
  std::vector<int> num_iterations;
};

// Grows to several times the number of factors that makes a task, loses some, and is held in part.
Trace Play(int num_threads, double batch_share) {
  IncrementalOptions options;
  options.num_threads = num_threads;
  options.batch_share = batch_share;
  IncrementalBundle bundle(options, 9);
  Trace trace;
  const auto update = [&] {
    const UpdateSummary summary = bundle.solver.Update();
    EXPECT_NE(summary.termination, Termination::kFailure) << summary.message;
    trace.costs.push_back(summary.final_cost);
    trace.values.push_back(bundle.Values());
    trace.num_iterations.push_back(summary.num_iterations);
  };
  const auto loss = std::make_shared<HuberLoss>(0.2);
  bundle.Grow(12, 500, 4, loss);
  update();
  for (int step = 0; step < 2; ++step) {
    bundle.Grow(3, 150, 4, loss);
    update();
  }
  EXPECT_GT(bundle.num_factors(), 2000);
  for (int k = 0; k < 100; ++k) {
    bundle.RemoveVariable(bundle.landmarks()[3 * k]);
    bundle.SetConstant(bundle.landmarks()[3 * k], true);
  }
  bundle.SetConstant(bundle.frames()[0], true);
  for (const FactorId view : bundle.Views()) {
    bundle.SetLoss(view, nullptr);
  }
  bundle.Apply();
  update();
  return trace;
}

TEST(IncrementalThreads, AnyNumberOfThreadsGivesTheSameBits) {
  for (const double batch_share : {0.5, 1.0}) {
    const Trace expected = Play(1, batch_share);
    for (const int num_threads : {2, 4}) {
      const Trace trace = Play(num_threads, batch_share);
      EXPECT_EQ(trace.costs, expected.costs) << num_threads << " threads";
      EXPECT_EQ(trace.num_iterations, expected.num_iterations) << num_threads << " threads";
      EXPECT_EQ(trace.values, expected.values) << num_threads << " threads";
    }
  }
}

}  // namespace
}  // namespace inceres
