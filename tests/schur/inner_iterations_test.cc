// Landmarks that improve by themselves with the frames held.

#include "schur/inner_iterations.h"

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "support/core_pipeline.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::BundleOptions;
using test::CorePipeline;
using test::JetFamily;
using test::MakeBundle;

BundleOptions Bundle() {
  BundleOptions options;
  options.num_frames = 12;
  options.num_landmarks = 200;
  options.landmark_sizes = {3, 1, 2};
  options.losses = options.constants = true;
  options.perturbation = 0.3;
  return options;
}

double CandidateCost(Evaluator* evaluator) {
  double cost = 0.0;
  EXPECT_TRUE(evaluator->EvaluateCandidateCost(&cost).ok());
  return cost;
}

TEST(InnerIterations, WhatTheySayTheyGainIsWhatTheCostFalls) {
  const auto bundle = MakeBundle(Bundle());
  CorePipeline core(bundle->graph());
  InnerIterations inner(&core.evaluator);
  double cost = CandidateCost(&core.evaluator);
  for (int pass = 0; pass < 4; ++pass) {
    const double gain = inner.Run(0.0);
    const double after = CandidateCost(&core.evaluator);
    EXPECT_GT(inner.num_moved(), 0);
    EXPECT_GT(gain, 0.0);
    EXPECT_NEAR(cost - after, gain, 1e-12 * cost);
    cost = after;
  }
}

TEST(InnerIterations, FramesStayAndPassesEndWhereEachLandmarkIsAtItsMinimum) {
  const auto bundle = MakeBundle(Bundle());
  CorePipeline core(bundle->graph());
  InnerIterations inner(&core.evaluator);
  for (int pass = 0; pass < 400; ++pass) {
    inner.Run(1e-15);
  }
  core.evaluator.AcceptCandidate();
  ASSERT_TRUE(core.evaluator.EvaluateJacobians(/*known_point=*/false, &core.cost).ok());
  core.hessian.Accumulate();
  const std::vector<double>& gradient = core.hessian.gradient();
  for (int k = core.layout.frame_size(); k < core.layout.size(); ++k) {
    EXPECT_NEAR(gradient[k], 0.0, 1e-3 * std::sqrt(core.hessian.diagonal()[k])) << "entry " << k;
  }
  for (int i = 0; i < core.layout.num_frames; ++i) {
    const VariableId id = core.layout.variables[i];
    for (int k = 0; k < core.evaluator.graph().AmbientSize(id); ++k) {
      EXPECT_EQ(core.evaluator.graph().ValuesIn(core.evaluator.points().current().data(), id)[k],
                core.evaluator.graph().Values(id)[k]);
    }
  }
}

TEST(InnerIterations, LeaveAloneWhatPromisesTooLittle) {
  const auto bundle = MakeBundle(Bundle());
  CorePipeline core(bundle->graph());
  InnerIterations inner(&core.evaluator);
  EXPECT_EQ(inner.Run(std::numeric_limits<double>::max()), 0.0);
  EXPECT_EQ(inner.num_moved(), 0);
  EXPECT_EQ(core.evaluator.points().candidate(), core.evaluator.points().current());
}

TEST(InnerIterations, LandmarksOnAManifoldStay) {
  BundleOptions options = Bundle();
  options.manifolds = true;
  const auto bundle = MakeBundle(options);
  CorePipeline core(bundle->graph());
  InnerIterations inner(&core.evaluator);
  EXPECT_GT(inner.Run(0.0), 0.0);
  int num_curved = 0;
  for (int l = 0; l < core.layout.num_landmarks(); ++l) {
    const VariableId id = core.layout.variables[core.layout.num_frames + l];
    if (core.evaluator.graph().manifold(id) == nullptr) {
      continue;
    }
    ++num_curved;
    for (int k = 0; k < core.evaluator.graph().AmbientSize(id); ++k) {
      EXPECT_EQ(core.evaluator.graph().ValuesIn(core.evaluator.points().candidate().data(), id)[k],
                core.evaluator.graph().Values(id)[k]);
    }
  }
  EXPECT_GT(num_curved, 0);
}

// A landmark y with the residual exp(y) − 1, which cannot be evaluated below `floor`.
struct Cliff {
  explicit Cliff(double floor) {
    const auto family =
        graph.AddFamily(JetFamily<1, 1, 1>([floor](const auto* /*x*/, const auto* y, auto* f) {
          using std::exp;
          f[0] = exp(y[0]) - 1.0;
          return y[0] >= floor;
        }));
    const double zero = 0.0;
    const double start = 2.0;
    const VariableId frame = graph.AddVariable(&zero, 1, Role::kFrame);
    landmark = graph.AddVariable(&start, 1, Role::kLandmark);
    graph.AddFactor(family, 0, {frame, landmark});
  }
  FactorGraph graph;
  VariableId landmark;
};

TEST(InnerIterations, AStepThatCannotBeEvaluatedIsTakenBackAndTheNextIsShorter) {
  Cliff cliff(/*floor=*/1.5);  // the full step goes to 2 − (1 − e⁻²) = 1.14
  CorePipeline core(cliff.graph);
  InnerIterations inner(&core.evaluator);
  const auto y = [&] {
    return *cliff.graph.ValuesIn(core.evaluator.points().candidate().data(), cliff.landmark);
  };
  EXPECT_EQ(inner.Run(0.0), 0.0);
  EXPECT_EQ(y(), 2.0);
  for (int pass = 0; pass < 8; ++pass) {
    inner.Run(0.0);
  }
  EXPECT_LT(y(), 2.0);
  EXPECT_GE(y(), 1.5);
}

// As Ceres's Tukey loss, for which what is not a number is far out.
struct BoundedLoss final : Loss {
  void Evaluate(double s, double rho[3]) const override {
    const bool is_inside = s <= 1.0;
    rho[0] = is_inside ? s : 1.0;
    rho[1] = is_inside ? 1.0 : 0.0;
    rho[2] = 0.0;
  }
};

TEST(InnerIterations, WhatABoundedLossMakesOfAFactorThatCannotBeEvaluatedCountsForNothing) {
  Cliff cliff(/*floor=*/0.0);
  const auto guarded = cliff.graph.AddFamily(JetFamily<1, 1>([](const auto* y, auto* f) {
    f[0] = 100.0 + y[0];
    return y[0] >= 1.5;
  }));
  cliff.graph.AddFactor(guarded, 0, {cliff.landmark}, std::make_shared<BoundedLoss>());
  CorePipeline core(cliff.graph);
  InnerIterations inner(&core.evaluator);
  EXPECT_EQ(inner.Run(0.0), 0.0);
  EXPECT_EQ(*cliff.graph.ValuesIn(core.evaluator.points().candidate().data(), cliff.landmark), 2.0);
}

// The landmarks rest one step, then two, then four, while they gain little; a gain that counts ends
// that.
TEST(InnerIterations, RestWhereLandmarksGainLittleBesideTheStep) {
  const auto bundle = MakeBundle(Bundle());
  CorePipeline core(bundle->graph());
  InnerIterations inner(&core.evaluator);
  const auto steps_until_due = [&] {
    int steps = 1;
    while (!inner.IsDue(1.0)) {
      ++steps;
    }
    return steps;
  };
  EXPECT_FALSE(inner.IsDue(1.0)) << "nothing creeps yet";
  EXPECT_EQ(steps_until_due(), 1);
  for (const int expected : {2, 3, 5}) {
    inner.Pace(0.01, 1.0);
    EXPECT_EQ(steps_until_due(), expected);
  }
  inner.Pace(0.5, 1.0);
  EXPECT_EQ(steps_until_due(), 1);
  inner.Pace(0.01, -1.0);  // the step itself went uphill
  EXPECT_EQ(steps_until_due(), 1);
  inner.Pace(0.01, 1.0);
  EXPECT_EQ(steps_until_due(), 1) << "all are asked before they rest";
  inner.Pace(0.01, 1.0);
  EXPECT_EQ(steps_until_due(), 2);
}

TEST(InnerIterations, LandmarksThatBroughtTheGainAreAskedAgainUntilTheyGainLittle) {
  const auto bundle = MakeBundle(Bundle());
  CorePipeline core(bundle->graph());
  InnerIterations inner(&core.evaluator);
  const double gain_of_all = inner.Run(0.0);
  const int num_all = inner.num_moved();
  inner.Pace(gain_of_all, gain_of_all);
  const double gain = inner.Run(0.0);
  EXPECT_GT(gain, 0.0);
  EXPECT_GT(inner.num_moved(), 0);
  EXPECT_LT(inner.num_moved(), num_all);
  inner.Pace(gain, 1e6 * gain);
  inner.Run(0.0);
  EXPECT_GT(inner.num_moved(), num_all / 2);
}

TEST(InnerIterations, OfManyLandmarksASampleTellsWhetherTheOthersAreAsked) {
  BundleOptions options = Bundle();
  options.num_landmarks = 1200;
  const auto bundle = MakeBundle(options);
  CorePipeline all(bundle->graph());
  InnerIterations unsampled(&all.evaluator);
  const double gain_of_all = unsampled.Run(0.0);

  CorePipeline worthwhile(bundle->graph());
  InnerIterations asks_all(&worthwhile.evaluator);
  EXPECT_EQ(asks_all.Run(0.0, /*step_gain=*/gain_of_all), gain_of_all);
  EXPECT_EQ(asks_all.num_moved(), unsampled.num_moved());
  EXPECT_EQ(worthwhile.evaluator.points().candidate(), all.evaluator.points().candidate())
      << "landmarks move by themselves";

  CorePipeline vain(bundle->graph());
  InnerIterations asks_few(&vain.evaluator);
  double sum = 0.0;
  int num_moved = 0;
  for (int eighth = 0; eighth < 8; ++eighth) {
    const double gain = asks_few.Run(0.0, /*step_gain=*/1e3 * gain_of_all);
    asks_few.Pace(gain, 1e3 * gain_of_all);
    EXPECT_LT(asks_few.num_moved(), unsampled.num_moved() / 4);
    sum += gain;
    num_moved += asks_few.num_moved();
  }
  EXPECT_NEAR(sum, gain_of_all, 1e-12 * gain_of_all)
      << "each time others are asked, in the end all";
  EXPECT_EQ(num_moved, unsampled.num_moved());
}

TEST(InnerIterations, WaitUntilStepsCreep) {
  const auto bundle = MakeBundle(Bundle());
  CorePipeline core(bundle->graph());
  InnerIterations inner(&core.evaluator);
  EXPECT_FALSE(inner.IsDue(1e6));
  EXPECT_FALSE(inner.IsDue(1e4)) << "Newton's method gets there without them";
  EXPECT_FALSE(inner.IsDue(1e2));
  EXPECT_TRUE(inner.IsDue(50.0));
}

// What a step lost says nothing about whether the next one creeps.
TEST(InnerIterations, AStepThatWentUphillIsNoneToCreepAfter) {
  const auto bundle = MakeBundle(Bundle());
  CorePipeline core(bundle->graph());
  InnerIterations inner(&core.evaluator);
  EXPECT_FALSE(inner.IsDue(1e3));
  EXPECT_FALSE(inner.IsDue(-1e3));
  EXPECT_FALSE(inner.IsDue(-1.0)) << "a smaller loss is no gain";
  EXPECT_FALSE(inner.IsDue(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_FALSE(inner.IsDue(1e2)) << "a tenth of what the last one that gained did";
  EXPECT_TRUE(inner.IsDue(50.0));
}

TEST(InnerIterations, SolvesEndAtTheSameMinimumWithTheSameBitsForAnyNumberOfThreads) {
  const auto plain = MakeBundle(Bundle());
  SolverOptions options;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-14;
  const Summary expected = Solve(options, &plain->graph());
  options.refine_landmarks = true;
  std::vector<double> state;
  for (const int num_threads : {1, 2, 4}) {
    const auto bundle = MakeBundle(Bundle());
    options.num_threads = num_threads;
    const Summary summary = Solve(options, &bundle->graph());
    EXPECT_GT(summary.work.num_refined_landmarks, 0);
    EXPECT_NEAR(summary.final_cost, expected.final_cost, 1e-9 * expected.final_cost);
    if (num_threads == 1) {
      state = bundle->graph().state();
    }
    EXPECT_EQ(bundle->graph().state(), state) << num_threads << " threads";
  }
}

}  // namespace
}  // namespace inceres::internal
