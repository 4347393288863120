// The ways an Update can go: through the batch solver alone, with the thesis's damping or rule,
// with and without steps of landmarks.

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "incremental/incremental_bundle.h"
#include "incremental/update_context.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using test::IncrementalBundle;

class BatchOnly : public testing::TestWithParam<TrustRegionStrategyKind> {};

// θ = 0 and everything anew: the batch solver, bit for bit.
TEST_P(BatchOnly, IsTheBatchSolverBitForBit) {
  IncrementalOptions options;
  options.batch_share = 0.0;
  options.batch_strategy = GetParam();
  IncrementalBundle bundle(options, 5);
  bundle.Grow(8, 60, 3, std::make_shared<HuberLoss>(0.3));
  FactorGraph graph = bundle.solver.graph();
  SolverOptions batch;
  batch.strategy = GetParam();
  batch.parameter_tolerance = 0.0;
  const Summary expected = Solve(batch, &graph);
  const UpdateSummary summary = bundle.solver.Update();
  EXPECT_EQ(summary.termination, expected.termination);
  EXPECT_EQ(summary.final_cost, expected.final_cost);
  EXPECT_EQ(bundle.solver.cost(), expected.final_cost);
  EXPECT_EQ(summary.num_batch_iterations, static_cast<int>(expected.iterations.size()) - 1);
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    for (int k = 0; k < graph.AmbientSize(id); ++k) {
      EXPECT_EQ(bundle.solver.Values(id)[k], graph.Values(id)[k]) << "variable " << id;
    }
  }
  // And again from there, with a frame more.
  bundle.Grow(1, 5, 2);
  EXPECT_GT(bundle.solver.Update().num_batch_iterations, 0);
}

INSTANTIATE_TEST_SUITE_P(Strategies, BatchOnly,
                         testing::Values(TrustRegionStrategyKind::kLevenbergMarquardt,
                                         TrustRegionStrategyKind::kDogleg));

TEST(BatchPhase, TakesAnUpdateThatIsMostlyNewAndNoOther) {
  IncrementalOptions options;
  options.batch_share = 0.5;
  IncrementalBundle bundle(options, 6);
  bundle.Grow(10, 80, 3);
  EXPECT_GT(bundle.solver.Update().num_batch_iterations, 0);
  for (int round = 0; round < 3; ++round) {
    bundle.Grow(1, 4, 2);
    const UpdateSummary next = bundle.solver.Update();
    EXPECT_EQ(next.num_batch_iterations, 0) << "what waits to be linearized is not new";
    EXPECT_GT(next.num_iterations, 0);
    const double minimum = bundle.SolveInBatch(true).final_cost;
    EXPECT_LE(next.final_cost - minimum, 1e-6 * minimum);
  }
}

// Factors that wait and are removed are no longer there to be waited for: those that have come in
// their places are new.
TEST(BatchPhase, TakesAnUpdateWhoseFactorsWereExchangedWhileTheyWaited) {
  IncrementalBundle bundle(IncrementalOptions(), 1);
  bundle.Grow(8, 60, 3);
  ASSERT_GT(bundle.solver.Update().num_batch_iterations, 0);
  const std::vector<VariableId> old = bundle.landmarks();
  for (const VariableId landmark : old) {
    bundle.RemoveVariable(landmark);
  }
  bundle.Apply();
  for (std::size_t k = 0; k < old.size(); ++k) {
    const std::size_t first = k % 6;
    bundle.AddLandmark(
        {bundle.frames()[first], bundle.frames()[first + 1], bundle.frames()[first + 2]});
  }
  bundle.Apply();
  EXPECT_GT(bundle.solver.Update().num_batch_iterations, 0);
  // And what comes and goes again leaves the others waiting.
  const VariableId guest = bundle.AddLandmark({bundle.frames()[0], bundle.frames()[1]});
  bundle.Apply();
  bundle.RemoveVariable(guest);
  bundle.Apply();
  bundle.AddLandmark({bundle.frames()[0], bundle.frames()[1]});
  bundle.Apply();
  EXPECT_EQ(bundle.solver.Update().num_batch_iterations, 0);
}

// A large step threshold keeps old Jacobians until convergence is at stake: fewer linearizations
// than with a tiny one.
TEST(StepSizeRule, LinearizesByItsThreshold) {
  const auto linearized_with = [](double step) {
    IncrementalOptions options;
    options.batch_share = 1.0;
    options.relinearization = RelinearizationRule::kStepSize;
    options.relinearization_step = step;
    IncrementalBundle bundle(options, 4);
    bundle.Grow(8, 60, 3);
    return bundle.solver.Update().num_relinearized_factors;
  };
  EXPECT_GT(linearized_with(1e-12), linearized_with(1e3));
}

// θ = 0: whether S follows by difference or is summed anew, the iterates are the same up to
// rounding.
TEST(RebuildPolicy, DifferencesGiveTheIteratesOfRebuilding) {
  const auto play = [](RebuildPolicy policy, std::vector<double>* values) {
    IncrementalOptions options;
    options.batch_share = 1.0;
    options.relinearization_share = 0.0;
    options.truncation_share = 0.0;
    options.max_landmark_refinements = 0;
    options.rebuild = policy;
    IncrementalBundle bundle(options, 12);
    std::vector<double> costs;
    for (int step = 0; step < 6; ++step) {
      bundle.Grow(step == 0 ? 8 : 1, step == 0 ? 60 : 8, 6);  // many views: well conditioned
      const UpdateSummary summary = bundle.solver.Update();
      EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      EXPECT_EQ(summary.num_rebuilds == 0, policy == RebuildPolicy::kNever);
      for (const UpdateIteration& iteration : summary.iterations) {
        costs.push_back(iteration.cost);
      }
      const std::vector<double> now = bundle.Values();
      values->insert(values->end(), now.begin(), now.end());
    }
    return costs;
  };
  std::vector<double> rebuilt, followed;
  const std::vector<double> expected = play(RebuildPolicy::kAlways, &rebuilt);
  const std::vector<double> costs = play(RebuildPolicy::kNever, &followed);
  ASSERT_EQ(costs.size(), expected.size());
  for (std::size_t k = 0; k < costs.size(); ++k) {
    EXPECT_NEAR(costs[k], expected[k], 1e-9 * expected[k]) << "iteration " << k;
  }
  ASSERT_EQ(followed.size(), rebuilt.size());
  for (std::size_t k = 0; k < rebuilt.size(); ++k) {
    EXPECT_NEAR(followed[k], rebuilt[k], 1e-9 * std::max(1.0, std::fabs(rebuilt[k])))
        << "value " << k;
  }
}

TEST(RebuildPolicy, SaysHowSFollows) {
  const auto rebuilds_with = [](RebuildPolicy policy) {
    IncrementalOptions options;
    options.batch_share = 1.0;
    options.rebuild = policy;
    IncrementalBundle bundle(options, 4);
    bundle.Grow(8, 60, 3);
    const UpdateSummary summary = bundle.solver.Update();
    return std::make_pair(summary.num_rebuilds, summary.num_iterations);
  };
  EXPECT_EQ(rebuilds_with(RebuildPolicy::kNever).first, 0);
  const auto [rebuilds, iterations] = rebuilds_with(RebuildPolicy::kAlways);
  EXPECT_GE(rebuilds, iterations);
}

TEST(SetOptions, KeepsTheReducedSolverOfTheConstructor) {
  for (const bool pcg_first : {false, true}) {
    IncrementalOptions options;
    options.batch_share = 1.0;
    options.reduced_solver = pcg_first ? ReducedSolverKind::kPcg : ReducedSolverKind::kResumed;
    IncrementalBundle bundle(options, 4);
    options.reduced_solver = pcg_first ? ReducedSolverKind::kResumed : ReducedSolverKind::kPcg;
    bundle.solver.SetOptions(options);
    bundle.Grow(8, 60, 3);
    EXPECT_EQ(bundle.solver.Update().num_pcg_iterations > 0, pcg_first);
  }
}

TEST(RebuildPolicy, WhenCheaperRebuildsAfterStepsOfAllAndNotForOneNewFactor) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  options.function_tolerance = 1e-9;
  IncrementalBundle bundle(options, 4);
  bundle.Grow(8, 60, 3);
  EXPECT_GT(bundle.solver.Update().num_rebuilds, 0);
  options.max_num_iterations = 0;
  bundle.solver.SetOptions(options);
  bundle.Grow(0, 1, 3);
  const UpdateSummary one_landmark = bundle.solver.Update();
  EXPECT_GT(one_landmark.num_relinearized_factors, 0);
  EXPECT_EQ(one_landmark.num_rebuilds, 0);
}

// An outlier under a robust loss slides along a line, Gauss–Newton step by Gauss–Newton step; by
// itself the landmark gets there in few steps of the frames.
TEST(LandmarkPasses, BringOutliersHomeInFewerIterations) {
  const auto run = [](int passes) {
    IncrementalOptions options;
    options.batch_share = 1.0;
    options.max_landmark_refinements = passes;
    options.max_num_iterations = 500;
    options.function_tolerance = 1e-9;
    IncrementalSolver solver(options);
    // A frame held by a prior; a landmark l with residuals (l − x − m, 0.02 l): weak across, far
    // out along the first.
    const auto views =
        solver.AddFamily(test::JetFamily<2, 1, 1>([](int i, const auto* x, const auto* l, auto* f) {
          using std::sin;
          f[0] = l[0] - x[0] - (i == 0 ? 40.0 : 0.0);
          f[1] = 0.3 * sin(l[0]) + 0.1 * l[0];
        }));
    const auto priors =
        solver.AddFamily(test::ScalarFamily([](double x) { return 10.0 * x + std::sin(x); },
                                            [](double x) { return 10.0 + std::cos(x); }));
    GraphEdit edit(solver.graph());
    const double start[2] = {1.0, 30.0};
    const VariableId frame = edit.AddVariable(&start[0], 1, Role::kFrame);
    const VariableId landmark = edit.AddVariable(&start[1], 1, Role::kLandmark);
    edit.AddFactor(priors, 0, {frame});
    for (int i = 0; i < 10; ++i) {
      edit.AddFactor(priors, 0, {edit.AddVariable(&start[0], 1, Role::kFrame)});
    }
    for (int i = 0; i < 3; ++i) {
      edit.AddFactor(views, 0, {frame, landmark}, std::make_shared<HuberLoss>(0.5));
    }
    EXPECT_TRUE(solver.Apply(edit).ok());
    // Most of it new would keep landmarks from going ahead: a second Update, after the landmark is
    // put elsewhere, is not.
    solver.Update();
    edit.Restart();
    edit.SetValues(landmark, &start[1]);
    EXPECT_TRUE(solver.Apply(edit).ok());
    return solver.Update();
  };
  const UpdateSummary without = run(0);
  const UpdateSummary with = run(5);
  EXPECT_EQ(without.termination, Termination::kConvergence);
  EXPECT_EQ(with.termination, Termination::kConvergence);
  EXPECT_EQ(without.num_landmark_refinements, 0);
  EXPECT_GT(with.num_landmark_refinements, 0);
  EXPECT_LE(with.num_iterations, without.num_iterations);
  EXPECT_LE(with.final_cost, without.final_cost * (1.0 + 1e-6));
}

// A converged problem gets a frame that sees landmarks together with older ones.
struct Arrival {
  UpdateSummary summary;
  std::vector<double> frame;
  std::vector<double> others;  // the older frames
};
Arrival ArriveWith(
    int max_new_frame_steps, int max_num_iterations, bool hold_others,
    std::int64_t max_factor_evaluations = IncrementalOptions().max_factor_evaluations) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  IncrementalBundle bundle(options, 6);
  bundle.Grow(12, 80, 3);
  for (int k = 0; k < 4; ++k) {
    bundle.solver.Update();
  }
  options.max_new_frame_steps = max_new_frame_steps;
  options.max_num_iterations = max_num_iterations;
  options.max_factor_evaluations = max_factor_evaluations;
  bundle.solver.SetOptions(options);
  const std::vector<VariableId> others = bundle.frames();
  for (const VariableId id : others) {
    bundle.SetConstant(id, hold_others);
  }
  const VariableId frame = bundle.AddFrame();
  for (int k = 0; k < 6; ++k) {
    bundle.AddLandmark({others[others.size() - 2], others.back(), frame});
  }
  bundle.Apply();
  Arrival arrival;
  arrival.summary = bundle.solver.Update();
  const auto append = [&](VariableId id, std::vector<double>* values) {
    values->insert(values->end(), bundle.solver.Values(id),
                   bundle.solver.Values(id) + bundle.solver.graph().AmbientSize(id));
  };
  append(frame, &arrival.frame);
  for (const VariableId id : others) {
    append(id, &arrival.others);
  }
  return arrival;
}

TEST(NewFrameSteps, AreThoseOfTheNewFrameWithAllOthersHeld) {
  const Arrival unsolved = ArriveWith(0, 0, false);
  const std::vector<double>& before = unsolved.others;
  // The budget ends the Update after the step.
  const Arrival stepped = ArriveWith(1, 50, false, unsolved.summary.num_relinearized_factors + 1);
  const Arrival held = ArriveWith(0, 1, true);
  EXPECT_EQ(stepped.others, before);
  ASSERT_EQ(stepped.frame.size(), held.frame.size());
  for (std::size_t k = 0; k < held.frame.size(); ++k) {
    EXPECT_NEAR(stepped.frame[k], held.frame[k], 1e-9) << "entry " << k;
  }
  EXPECT_EQ(stepped.summary.num_moved_frames, 1);
  EXPECT_EQ(stepped.summary.num_factored_rows, 0);
  EXPECT_LT(stepped.summary.final_cost, stepped.summary.initial_cost);
}

// A landmark held constant does not even get its own value written anew.
TEST(NewFrameSteps, LeaveWhatIsHeld) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  IncrementalBundle bundle(options, 6);
  bundle.Grow(12, 80, 3);
  bundle.solver.Update();
  const std::vector<VariableId> frames = bundle.frames();
  const VariableId frame = bundle.AddFrame();
  const VariableId landmark = bundle.AddLandmark({frames.back(), frame});
  const VariableId held = bundle.AddLandmark({frames.back(), frame});
  bundle.Apply();
  bundle.SetConstant(held, true);
  bundle.Apply();
  const auto values_of = [&](VariableId id) {
    const double* values = bundle.solver.Values(id);
    return std::vector<double>(values, values + bundle.solver.graph().AmbientSize(id));
  };
  const std::vector<double> before = values_of(held);
  const std::vector<double> other_before = values_of(landmark);
  const UpdateSummary summary = bundle.solver.Update();
  ASSERT_GT(summary.iterations.size(), 1U);
  EXPECT_EQ(summary.iterations[1].num_moved_frames, 1);
  EXPECT_EQ(summary.iterations[1].num_visited_landmarks, 1);
  EXPECT_EQ(values_of(held), before);
  EXPECT_NE(values_of(landmark), other_before);
}

TEST(NewFrameSteps, LeaveAnIterationToTheOthers) {
  const Arrival one = ArriveWith(3, 1, false);
  EXPECT_NE(one.others, ArriveWith(0, 0, false).others);
  EXPECT_EQ(one.summary.num_iterations, 1);
  EXPECT_GT(one.summary.num_factored_rows, 0);
}

TEST(NewFrameSteps, SpareTheReducedSystem) {
  const UpdateSummary with = ArriveWith(3, 50, false).summary;
  const UpdateSummary without = ArriveWith(0, 50, false).summary;
  EXPECT_EQ(with.termination, Termination::kConvergence);
  EXPECT_EQ(without.termination, Termination::kConvergence);
  EXPECT_LT(with.num_factored_rows, without.num_factored_rows);
  EXPECT_NEAR(with.final_cost, without.final_cost, 1e-6 * without.final_cost);
}

// Two cameras close together see a point so that their rays part: it is best at infinity. A third,
// far from them, then sees it well.
TEST(LandmarkDamping, AFarPointDoesNotRunAway) {
  // Residuals: how far the camera is from where the prior has it, and the point (X, Z) in the
  // image; slots: camera, point.
  const auto camera_at = [](double position, double seen) {
    return test::JetFamily<2, 1, 2>([=](const auto* camera, const auto* point, auto* f) {
      f[0] = 1e4 * camera[0];
      f[1] = 500.0 * ((point[0] - position - camera[0]) / point[1] - seen);
    });
  };
  IncrementalOptions options;
  options.batch_share = 1.0;  // never in batch
  IncrementalSolver solver(options);
  const std::vector<double> start = {10.0, 10.0};
  VariableId point = -1;
  const auto see = [&](double position, double seen) {
    const double zero = 0.0;
    const auto family = solver.AddFamily(camera_at(position, seen));
    GraphEdit edit(solver.graph());
    const VariableId camera = edit.AddVariable(&zero, 1, Role::kFrame);
    if (point < 0) {
      point = edit.AddVariable(start.data(), 2, Role::kLandmark);
    }
    edit.AddFactor(family, 0, {camera, point});
    ASSERT_TRUE(solver.Apply(edit).ok());
  };
  see(0.0, 1.0);
  see(1e-3, 1.0 + 1e-4);
  for (int k = 0; k < 5; ++k) {
    solver.Update();
  }
  EXPECT_GT(solver.Values(point)[1], 20.0);
  EXPECT_LT(solver.Values(point)[1], 1e3);
  see(1.0, 0.9);
  ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
  EXPECT_NEAR(solver.Values(point)[1], 10.0, 0.1);
}

TEST(Shares, FollowFromTheGraphUnlessTheyAreGiven) {
  IncrementalOptions options;
  const internal::Shares bundle = internal::SharesOf(options, 5);
  EXPECT_EQ(bundle.relinearization, 0.1);
  EXPECT_EQ(bundle.truncation, 0.03);
  const internal::Shares poses = internal::SharesOf(options, 0);
  EXPECT_EQ(poses.relinearization, 0.003);
  EXPECT_EQ(poses.truncation, 0.0);
  options.relinearization = RelinearizationRule::kStepSize;
  EXPECT_EQ(internal::SharesOf(options, 0).relinearization, 0.1);
  options.relinearization_share = 0.02;
  options.truncation_share = 0.2;
  const internal::Shares given = internal::SharesOf(options, 0);
  EXPECT_EQ(given.relinearization, 0.02);
  EXPECT_EQ(given.truncation, 0.2);
}

}  // namespace
}  // namespace inceres
