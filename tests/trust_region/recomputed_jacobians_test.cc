// Solves that keep no Jacobians take the iterations of those that do, up to rounding, in less
// memory.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/random_graph.h"
#include "support/test_families.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

using test::LongBundle;
using test::MakeBundle;
using test::SolverWay;

SolverOptions Options(int num_iterations) {
  SolverOptions options;
  options.max_num_iterations = num_iterations;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  return options;
}

class RecomputedJacobians : public ::testing::TestWithParam<SolverWay> {};

TEST_P(RecomputedJacobians, TakeTheIterationsOfThoseThatAreKept) {
  for (const bool by_frame : {false, true}) {
    const auto kept = MakeBundle(LongBundle(by_frame)), anew = MakeBundle(LongBundle(by_frame));
    SolverOptions options = GetParam().options;
    options.max_num_iterations = 8;
    options.num_threads = 2;
    options.initial_trust_region_radius = 1e6;
    options.recompute_jacobians = false;
    const Summary expected = Solve(options, &kept->graph());
    options.recompute_jacobians = true;
    const Summary summary = Solve(options, &anew->graph());
    ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
    EXPECT_TRUE(summary.recomputed_jacobians);
    EXPECT_FALSE(expected.recomputed_jacobians);
    ASSERT_EQ(summary.iterations.size(), expected.iterations.size());
    for (std::size_t k = 0; k < summary.iterations.size(); ++k) {
      const IterationSummary& a = summary.iterations[k];
      const IterationSummary& b = expected.iterations[k];
      EXPECT_NEAR(a.cost, b.cost, 1e-10 * b.cost) << k;
      EXPECT_NEAR(a.model_cost_change, b.model_cost_change, 1e-7 * b.model_cost_change) << k;
      EXPECT_EQ(a.step_is_successful, b.step_is_successful) << k;
    }
    EXPECT_LT(summary.work.bytes, 0.85 * static_cast<double>(expected.work.bytes));
    EXPECT_NE(summary.FullReport().find("Jacobians not kept"), std::string::npos);
  }
}

std::vector<SolverWay> RecomputingWays() {
  std::vector<SolverWay> ways = test::SolverWays();
  ways.erase(std::remove_if(ways.begin(), ways.end(),
                            [](const SolverWay& way) { return !way.options.recompute_jacobians; }),
             ways.end());
  return ways;
}

INSTANTIATE_TEST_SUITE_P(Ways, RecomputedJacobians, testing::ValuesIn(RecomputingWays()),
                         test::NameOf);

TEST(RecomputedJacobiansOfFrames, TakeTheIterationsOfThoseThatAreKept) {
  test::BundleOptions bundle = LongBundle(/*by_frame=*/false);
  bundle.num_landmarks = 150;  // as frames
  const auto kept = MakeBundle(bundle), anew = MakeBundle(bundle);
  SolverOptions options = Options(6);
  options.linear_model = LinearModelKind::kPlain;
  const Summary expected = Solve(options, &kept->graph());
  options.recompute_jacobians = true;
  const Summary summary = Solve(options, &anew->graph());
  EXPECT_NEAR(summary.final_cost, expected.final_cost, 1e-9 * expected.final_cost);
  EXPECT_TRUE(summary.recomputed_jacobians);
}

// Between the memory of the two ways there are budgets that only one fits into: taken by itself,
// and no other.
TEST(RecomputedJacobiansByThemselves, FitWhereThoseThatAreKeptDoNot) {
  SolverOptions options = Options(4);
  options.linear_model = LinearModelKind::kSchur;
  const auto free = MakeBundle(LongBundle(false));
  const Summary kept = Solve(options, &free->graph());
  int num_recomputed = 0, num_kept = 0, num_refused = 0;
  for (double share = 0.1; share < 2.0; share += 0.1) {
    options.max_memory_bytes =
        static_cast<std::int64_t>(share * static_cast<double>(kept.work.bytes));
    const auto bundle = MakeBundle(LongBundle(false));
    const std::vector<double> before = bundle->graph().state();
    const Summary summary = Solve(options, &bundle->graph());
    if (!summary.IsSolutionUsable()) {
      ++num_refused;
      EXPECT_NE(summary.message.find("does not fit into memory"), std::string::npos);
      EXPECT_EQ(bundle->graph().state(), before);
      EXPECT_EQ(num_recomputed + num_kept, 0) << "a smaller budget was enough";
    } else if (summary.recomputed_jacobians) {
      ++num_recomputed;
      EXPECT_EQ(num_kept, 0);
      EXPECT_LE(summary.work.bytes, options.max_memory_bytes);
    } else {
      ++num_kept;
      EXPECT_EQ(summary.final_cost, kept.final_cost);
    }
    if (summary.IsSolutionUsable()) {
      EXPECT_NEAR(summary.final_cost, kept.final_cost, 1e-9 * kept.final_cost);
    }
  }
  EXPECT_GT(num_refused, 0);
  EXPECT_GT(num_recomputed, 0);
  EXPECT_GT(num_kept, 0);
}

// Where that is not possible, a solve that does not fit is refused as ever.
TEST(RecomputedJacobiansByThemselves, AreNotTakenWhereSomebodyReadsThem) {
  SolverOptions options = Options(4);
  const auto free = MakeBundle(LongBundle(false));
  options.refine_landmarks = true;
  const Summary kept = Solve(options, &free->graph());
  options.max_memory_bytes = kept.work.bytes / 2;
  const auto bundle = MakeBundle(LongBundle(false));
  EXPECT_FALSE(Solve(options, &bundle->graph()).IsSolutionUsable());
}

class Watcher : public SolveObserver {};

TEST(RecomputedJacobiansAskedFor, AreRefusedWhereTheyCannotBe) {
  SolverOptions options;
  options.recompute_jacobians = true;
  for (const LinearModelKind model : {LinearModelKind::kDenseQr, LinearModelKind::kIterativeSchur,
                                      LinearModelKind::kIterativePlain}) {
    options.linear_model = model;
    EXPECT_NE(options.Validate().message.find("recompute_jacobians"), std::string::npos);
  }
  options.linear_model = LinearModelKind::kAutomatic;
  EXPECT_TRUE(options.Validate().ok());
  Watcher watcher;
  options.observer = &watcher;
  const auto bundle = MakeBundle(LongBundle(false));
  const Summary summary = Solve(options, &bundle->graph());
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.message.find("recompute_jacobians"), std::string::npos) << summary.message;
}

// A small problem of few unknowns has a model of its own, which keeps Jacobians.
TEST(RecomputedJacobiansAskedFor, HoldForSmallProblems) {
  test::BundleOptions bundle;
  bundle.num_frames = 2;
  bundle.num_views = 2;
  bundle.num_landmarks = 4;
  bundle.perturbation = 0.1;
  const auto kept = MakeBundle(bundle), anew = MakeBundle(bundle);
  SolverOptions options;
  const Summary expected = Solve(options, &kept->graph());
  options.recompute_jacobians = true;
  const Summary summary = Solve(options, &anew->graph());
  EXPECT_NEAR(summary.final_cost, expected.final_cost, 1e-9 * (1.0 + expected.final_cost));
  EXPECT_TRUE(summary.recomputed_jacobians);
}

// What an earlier solve of the same structure was allowed does not bind a later one.
TEST(RecomputedJacobiansOfAReusedSolver, FollowTheBudgetOfEachSolve) {
  SolverOptions options = Options(2);
  const auto solve = [&](Solver* solver, std::int64_t budget) {
    options.max_memory_bytes = budget;
    const auto bundle = MakeBundle(LongBundle(/*by_frame=*/true));
    return solver->Solve(options, &bundle->graph());
  };
  Solver solver(std::int64_t{1} << 30);
  const std::int64_t bytes = solve(&solver, 0).work.bytes;
  for (int round = 0; round < 2; ++round) {
    const Summary tight = solve(&solver, bytes);
    EXPECT_TRUE(tight.IsSolutionUsable() && tight.recomputed_jacobians) << tight.message;
    const Summary ample = solve(&solver, 0);
    EXPECT_TRUE(ample.IsSolutionUsable() && !ample.recomputed_jacobians) << ample.message;
    EXPECT_EQ(solve(&solver, bytes / 100).termination, Termination::kFailure);
  }
}

// Factors that are costly are few to a task; the first call waits for a second one beside it.
TEST(RecomputedJacobiansAskedFor, AreEvaluatedByAllThreadsHoweverFewFactorsAChunkHas) {
  constexpr int kFactors = 200;
  FactorGraph graph;
  const double one = 1.0;
  std::atomic<int> num_inside = 0;
  std::atomic<bool> met = false;
  const auto wait = [&](double x) {
    ++num_inside;
    for (int ms = 0; ms < 10000 && !met; ++ms) {
      met = met || num_inside > 1;
      std::this_thread::sleep_for(std::chrono::milliseconds(met ? 0 : 1));
    }
    --num_inside;
    return x;
  };
  const auto family = graph.AddFamily(test::ScalarFamily(wait, 1.0));
  for (int i = 0; i < kFactors; ++i) {
    graph.AddFactor(family, 0, {graph.AddVariable(&one, 1, Role::kFrame)});
  }
  SolverOptions options;
  options.num_threads = 2;
  options.recompute_jacobians = true;
  options.max_num_iterations = 0;
  EXPECT_TRUE(Solve(options, &graph).IsSolutionUsable());
  EXPECT_TRUE(met);
}

// Factors of constant points, which no chunk of landmarks needs, do not make one of them large.
TEST(RecomputedJacobiansAskedFor, TakeNoMoreWhereConstantPointsLieBetweenOthers) {
  std::vector<double> bytes;
  for (const bool between : {false, true}) {
    test::RandomGraph random(3);
    std::vector<VariableId> frames(20);
    for (VariableId& frame : frames) {
      frame = random.AddFrame(6);
      random.Connect(6, {frame});
    }
    const auto add_points = [&](int count, bool constant) {
      for (int k = 0; k < count; ++k) {
        const VariableId point = random.AddLandmark(3);
        random.graph().SetConstant(point, constant);
        for (int view = 0; view < 4; ++view) {
          random.Connect(2, {frames[static_cast<std::size_t>(k + view) % frames.size()], point});
        }
      }
    };
    add_points(between ? 1 : 2, false);
    add_points(10000, true);
    add_points(between ? 1 : 0, false);
    SolverOptions options;
    options.max_num_iterations = 1;
    options.recompute_jacobians = true;
    const Summary summary = Solve(options, &random.graph());
    ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
    bytes.push_back(static_cast<double>(summary.work.bytes));
  }
  EXPECT_LT(bytes[1], 1.5 * bytes[0]);
}

// Factors of two chunks that cannot be evaluated a second time where they are: no step is made of
// what is not there.
TEST(RecomputedJacobiansAskedFor, ThatCannotBeEvaluatedAgainMakeNoStep) {
  FactorGraph graph;
  const double one = 1.0;
  const VariableId x = graph.AddVariable(&one, 1, Role::kFrame);
  std::atomic<int> num_linearized = 0;
  constexpr int kFactors = 70000;
  const auto family = graph.AddFamily(std::make_shared<test::FunctionFamily>(
      1, std::vector<FactorFamily::Slot>{{1, 1}},
      [&](int, const double* const* parameters, double* residuals, double** jacobians) {
        residuals[0] = parameters[0][0];
        if (jacobians == nullptr || jacobians[0] == nullptr) {
          return true;
        }
        jacobians[0][0] = 1.0;
        return ++num_linearized <= kFactors;
      }));
  for (int i = 0; i < kFactors; ++i) {
    graph.AddFactor(family, 0, {x});
  }
  SolverOptions options;
  options.recompute_jacobians = true;
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kFailure) << summary.message;
  EXPECT_GT(num_linearized, kFactors);
  EXPECT_EQ(graph.state(), std::vector<double>{one});
}

}  // namespace
}  // namespace inceres
