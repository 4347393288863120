// Wrong loops are told from right ones, and the result is that of the right ones alone.
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "robust/gnc_worlds.h"

namespace inceres {
namespace {

using test::GncWorld;
using test::PoseGraphWorld;

void ExpectEveryWrongOneIsFound(const GncWorld& world, const GncSummary& summary) {
  ASSERT_EQ(summary.verdicts.size(), world.suspects.size()) << summary.message;
  int num_lost = 0;
  for (std::size_t k = 0; k < world.suspects.size(); ++k) {
    const GncVerdict& verdict = summary.verdicts[k];
    EXPECT_EQ(verdict.factor.index, world.suspects[k].index);
    EXPECT_EQ(verdict.inlier, verdict.squared_error <= verdict.threshold);
    if (world.IsWrong(k)) {
      EXPECT_FALSE(verdict.inlier) << "wrong loop " << k;
    } else {
      num_lost += verdict.inlier ? 0 : 1;
    }
  }
  const double expected = 0.012 * world.world.num_right;  // and three standard deviations
  EXPECT_LE(num_lost, expected + 3.0 * std::sqrt(expected));
  EXPECT_EQ(summary.num_outliers, world.world.num_wrong + num_lost);
}

TEST(Gnc, FindsWrongLoopsInThePlaneAndInSpace) {
  for (const int dimension : {2, 3}) {
    SCOPED_TRACE(dimension);
    GncWorld world(PoseGraphWorld(dimension, 200, 40, 60, 0.02, 7));
    ASSERT_TRUE(world.started.ok()) << world.started.message;
    const GncSummary summary = SolveGnc(world.Options(), world.suspects, &world.graph);
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    ExpectEveryWrongOneIsFound(world, summary);
    GncWorld right(PoseGraphWorld(dimension, 200, 40, 0, 0.02, 7));
    ASSERT_TRUE(Solve(SolverOptions(), &right.graph).IsSolutionUsable());
    EXPECT_LT(PoseGraphWorld::LargestDistance(world.Solved(), right.Solved()), 0.1);
    EXPECT_GT(summary.rounds.size(), 3u);
  }
}

TEST(Gnc, LeavesTheWeightsOfTruncatedLeastSquaresAsLosses) {
  GncWorld world(PoseGraphWorld(2, 120, 40, 20, 0.02, 3));
  const GncSummary summary = SolveGnc(world.Options(), world.suspects, &world.graph);
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  for (const GncVerdict& verdict : summary.verdicts) {
    EXPECT_EQ(verdict.weight, verdict.inlier ? 1.0 : 0.0);
    const Loss* loss = world.graph.loss(verdict.factor.family, verdict.factor.index);
    if (verdict.inlier) {
      EXPECT_EQ(loss, nullptr);
    } else {
      double rho[3];
      loss->Evaluate(5.0, rho);
      EXPECT_EQ(rho[0], 0.0);
    }
  }
  // The graph as it is left has the cost, at its minimum, that the summary tells of.
  SolverOptions again;
  const Summary solved = Solve(again, &world.graph);
  EXPECT_NEAR(solved.initial_cost, summary.final_cost, 1e-9 * summary.final_cost);
  EXPECT_NEAR(solved.final_cost, summary.final_cost, 1e-5 * summary.final_cost);
}

TEST(Gnc, GemanMcClureFindsThemToo) {
  GncWorld world(PoseGraphWorld(2, 120, 40, 25, 0.02, 11));
  GncOptions options = world.Options();
  options.kernel = GncKernel::kGemanMcClure;
  const GncSummary summary = SolveGnc(options, world.suspects, &world.graph);
  ExpectEveryWrongOneIsFound(world, summary);
  for (std::size_t k = 0; k < world.suspects.size(); ++k) {
    const GncVerdict& verdict = summary.verdicts[k];
    const double ratio = verdict.squared_error / verdict.threshold;
    EXPECT_NEAR(verdict.weight, 1.0 / ((1.0 + ratio) * (1.0 + ratio)), 0.02) << k;
  }
}

TEST(Gnc, WithoutWrongLoopsIsTheLeastSquaresSolution) {
  GncWorld world(PoseGraphWorld(2, 120, 40, 0, 0.02, 5));
  GncWorld plain = GncWorld(PoseGraphWorld(2, 120, 40, 0, 0.02, 5));
  GncOptions options = world.Options();
  options.inlier_probability = 1.0 - 1e-9;
  options.solver.function_tolerance = 1e-14;
  const GncSummary summary = SolveGnc(options, world.suspects, &world.graph);
  EXPECT_EQ(summary.num_outliers, 0);
  SolverOptions least_squares;
  least_squares.function_tolerance = 1e-14;
  const Summary solved = Solve(least_squares, &plain.graph);
  EXPECT_NEAR(summary.final_cost, solved.final_cost, 1e-8 * solved.final_cost);
  EXPECT_LT(PoseGraphWorld::LargestDistance(world.Solved(), plain.Solved()), 1e-5);
}

TEST(Gnc, GivesTheSameBitsForAnyNumberOfThreads) {
  std::vector<double> state;
  for (const int threads : {1, 2, 4}) {
    GncWorld world(PoseGraphWorld(3, 150, 30, 30, 0.02, 9));
    GncOptions options = world.Options();
    options.solver.num_threads = threads;
    SolveGnc(options, world.suspects, &world.graph);
    if (state.empty()) {
      state = world.graph.state();
    }
    EXPECT_EQ(world.graph.state(), state) << threads;
  }
}

// Failures name the culprit and leave values and losses.
class GncFailure : public testing::Test {
 protected:
  void ExpectRefused(const GncOptions& options, const std::string& culprit) {
    const std::vector<double> state = world_.graph.state();
    const GncSummary summary = SolveGnc(options, world_.suspects, &world_.graph);
    EXPECT_EQ(summary.termination, Termination::kFailure);
    EXPECT_NE(summary.message.find(culprit), std::string::npos) << summary.message;
    EXPECT_EQ(world_.graph.state(), state);
    EXPECT_FALSE(world_.graph.HasLosses(world_.ids.planar.id));
    EXPECT_TRUE(summary.verdicts.empty());
  }
  GncWorld world_{PoseGraphWorld(2, 60, 20, 5, 0.02, 1)};
};

TEST_F(GncFailure, NamesABadOption) {
  GncOptions options;
  options.inlier_probability = 1.0;
  ExpectRefused(options, "inlier_probability");
  options = GncOptions();
  options.step = 1.0;
  ExpectRefused(options, "step");
  options = GncOptions();
  options.threshold_scale = std::numeric_limits<double>::quiet_NaN();
  ExpectRefused(options, "threshold_scale");
  options = GncOptions();
  options.max_rounds = 0;
  ExpectRefused(options, "max_rounds");
  options = GncOptions();
  options.iterations_a_round = 0;
  ExpectRefused(options, "iterations_a_round");
  options = GncOptions();
  options.solver.num_threads = 0;
  ExpectRefused(options, "num_threads");
}

TEST_F(GncFailure, NamesASuspectThatIsNotThereOrTwice) {
  world_.suspects.push_back({world_.ids.planar.id, 100000, -1});
  ExpectRefused(GncOptions(), "planar relative pose 100000 is not in the graph");
  world_.suspects.back() = {7, 0, -1};
  ExpectRefused(GncOptions(), "factor 0 of family 7");
  world_.suspects.back() = world_.suspects.front();
  ExpectRefused(GncOptions(), "is named twice");
}

TEST_F(GncFailure, TellsWhatTheStartSays) {
  GncOptions options;
  options.start = [](const std::vector<double>&, FactorGraph*) {
    return Status::Error(StatusCode::kSingular, "no start today");
  };
  ExpectRefused(options, "no start today");
}

TEST_F(GncFailure, NamesASolveThatFails) {
  PlanarRelativePoseFamily::Measurement bad = world_.ids.planar->measurement(70);
  bad.motion[0] = std::numeric_limits<double>::quiet_NaN();
  world_.ids.planar->Place(70, bad);
  ExpectRefused(GncOptions(), "planar relative pose");
}

// Whenever it does: in the first solve, in one of those with weights, in a second look.
TEST(Gnc, AnObserverThatAbortsLeavesTheGraph) {
  class Aborting final : public SolveObserver {
   public:
    explicit Aborting(int last) : last_(last) {}
    ObserverAction EndOfIteration(const IterationSummary& /*iteration*/,
                                  const double* /*state*/) override {
      return ++num_calls_ < last_ ? ObserverAction::kContinue : ObserverAction::kAbort;
    }
    int num_calls() const { return num_calls_; }

   private:
    const int last_;
    int num_calls_ = 0;
  };
  Aborting never(1 << 30);
  GncWorld whole(PoseGraphWorld(2, 60, 20, 5, 0.02, 1));
  GncOptions options = whole.Options();
  options.solver.observer = &never;
  ASSERT_TRUE(SolveGnc(options, whole.suspects, &whole.graph).IsSolutionUsable());
  for (int last = 1; last <= never.num_calls(); last += 1 + never.num_calls() / 20) {
    GncWorld world(PoseGraphWorld(2, 60, 20, 5, 0.02, 1));
    options = world.Options();
    Aborting aborting(last);
    options.solver.observer = &aborting;
    const std::vector<double> state = world.graph.state();
    const GncSummary summary = SolveGnc(options, world.suspects, &world.graph);
    EXPECT_EQ(summary.termination, Termination::kUserFailure) << last;
    EXPECT_FALSE(summary.IsSolutionUsable());
    EXPECT_EQ(aborting.num_calls(), last);
    EXPECT_EQ(world.graph.state(), state) << last;
    EXPECT_FALSE(world.graph.HasLosses(world.ids.planar.id));
  }
}

TEST(Gnc, StopsAtMaxRounds) {
  GncWorld world(PoseGraphWorld(2, 120, 40, 20, 0.02, 3));
  GncOptions options = world.Options();
  options.max_rounds = 3;
  const GncSummary summary = SolveGnc(options, world.suspects, &world.graph);
  EXPECT_EQ(summary.termination, Termination::kNoConvergence) << summary.message;
  EXPECT_LE(summary.rounds.size(), 4u);
  EXPECT_EQ(summary.verdicts.size(), world.suspects.size());
}

// Wherever the rounds end, weights, cost and state are those of one problem.
TEST(Gnc, AtTheLimitItsLossesAreThoseItWasSolvedWith) {
  for (int max_rounds = 1; max_rounds < 12; ++max_rounds) {
    GncWorld world(PoseGraphWorld(2, 120, 40, 20, 0.02, 3));
    GncOptions options = world.Options();
    options.max_rounds = max_rounds;
    const GncSummary summary = SolveGnc(options, world.suspects, &world.graph);
    ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
    SolverOptions look;
    look.max_num_iterations = 0;
    EXPECT_NEAR(Solve(look, &world.graph).initial_cost, summary.final_cost,
                1e-9 * summary.final_cost)
        << max_rounds;
  }
}

// Most suspects are left out, and nothing that the user asked for is refused for that.
TEST(Gnc, GoesWithEveryLinearModel) {
  for (const LinearModelKind model :
       {LinearModelKind::kAutomatic, LinearModelKind::kPlain, LinearModelKind::kDenseQr,
        LinearModelKind::kIterativePlain}) {
    for (const bool recompute : {false, true}) {
      GncWorld world(PoseGraphWorld(2, 60, 20, 20, 0.02, 3));
      GncOptions options = world.Options();
      options.solver.linear_model = model;
      options.solver.strategy = TrustRegionStrategyKind::kLevenbergMarquardt;
      options.solver.recompute_jacobians = recompute;
      if (!options.solver.Validate().ok()) {
        continue;
      }
      const GncSummary summary = SolveGnc(options, world.suspects, &world.graph);
      EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
      EXPECT_GT(summary.num_outliers, 10);
    }
  }
}

TEST(Gnc, OfConstantsTakesNoIterations) {
  GncWorld world(PoseGraphWorld(2, 60, 20, 5, 0.02, 1));
  for (const VariableId pose : world.ids.poses) {
    world.graph.SetConstant(pose, true);
  }
  const GncSummary summary = SolveGnc(world.Options(), world.suspects, &world.graph);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_EQ(summary.num_iterations, 0);
}

}  // namespace
}  // namespace inceres
