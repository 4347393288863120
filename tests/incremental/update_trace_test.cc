// The trace of an Update, one row an iteration, and who sees each row and may end the Update: an
// observer, or the callback of the options.

#include <cmath>
#include <functional>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "incremental/incremental_bundle.h"

namespace inceres {
namespace {

using test::IncrementalBundle;

// Calls a function for every row.
class Watcher final : public UpdateObserver {
 public:
  using Watch = std::function<ObserverAction(const UpdateIteration&)>;
  explicit Watcher(Watch watch) : watch_(std::move(watch)) {}
  ObserverAction EndOfIteration(const UpdateIteration& iteration) override {
    return watch_(iteration);
  }

 private:
  Watch watch_;
};

UpdateSummary UpdateWatched(bool by_callback, const Watcher::Watch& watch,
                            IncrementalOptions options, IncrementalBundle* bundle) {
  UpdateSummary summary;
  if (by_callback) {
    options.callback = watch;
    bundle->solver.SetOptions(options);
    summary = bundle->solver.Update();
    options.callback = nullptr;
    bundle->solver.SetOptions(options);
  } else {
    Watcher watcher(watch);
    bundle->solver.Update(&summary, &watcher);
  }
  return summary;
}

// By the batch solver first; by the incremental one alone; by both, with landmark steps and refused
// steps on the way.
std::vector<IncrementalOptions> Ways() {
  IncrementalOptions batch;
  batch.function_tolerance = 1e-9;
  batch.max_num_iterations = 300;
  IncrementalOptions incremental = batch;
  incremental.batch_share = 1.0;
  IncrementalOptions batch_only = batch;
  batch_only.batch_share = 0.0;
  IncrementalOptions timid = incremental;
  timid.reduced_solver = ReducedSolverKind::kPcg;
  timid.initial_damping = timid.min_damping = 1e-12;
  return {batch, incremental, batch_only, timid};
}

struct Kinds {
  int landmarks = 0;
  int batch = 0;
  int frames = 0;
};

void ExpectSumsOf(const UpdateSummary& summary, int num_factors, Kinds* kinds) {
  std::int64_t num_relinearized = 0;
  std::int64_t num_evaluated = 0;
  int num_moved = 0;
  int num_batch = 0;
  int num_rejected = 0;
  for (const UpdateIteration& row : summary.iterations) {
    num_relinearized += row.num_relinearized_factors;
    num_evaluated += row.num_evaluated_factors;
    num_moved += row.num_moved_frames;
    num_batch += row.step == UpdateStep::kBatch ? 1 : 0;
    num_rejected += row.step != UpdateStep::kNone && !row.step_is_successful ? 1 : 0;
    kinds->landmarks += row.step == UpdateStep::kLandmarks ? 1 : 0;
    kinds->frames += row.step == UpdateStep::kFrames ? 1 : 0;
  }
  kinds->batch += num_batch;
  EXPECT_EQ(num_batch, summary.num_batch_iterations);
  EXPECT_EQ(num_rejected, summary.num_unsuccessful_steps);
  // Nor has what the living solver linearized after it to find that nothing is left.
  EXPECT_LE(num_relinearized, summary.num_relinearized_factors);
  EXPECT_GE(num_relinearized, summary.num_relinearized_factors - (num_batch > 0 ? num_factors : 0));
  EXPECT_EQ(num_moved, summary.num_moved_frames);
  // What the batch solver's last, discarded candidate took has no row of its own.
  EXPECT_LE(num_evaluated, summary.num_evaluated_factors);
  EXPECT_GE(num_evaluated, summary.num_evaluated_factors - num_factors);
}

void ExpectConsistent(const UpdateIteration& row, const UpdateIteration& previous) {
  EXPECT_EQ(row.iteration, previous.iteration + 1);
  EXPECT_GE(row.cumulative_time_in_seconds, previous.cumulative_time_in_seconds);
  EXPECT_LE(row.step_solver_time_in_seconds, row.iteration_time_in_seconds);
  EXPECT_NEAR(row.cost, row.step_is_successful ? previous.cost - row.cost_change : previous.cost,
              1e-9 * previous.cost);
  if (row.step == UpdateStep::kNone) {
    return;
  }
  EXPECT_GT(row.step_norm, 0.0);
  EXPECT_GT(row.num_evaluated_factors, 0);
  if (row.step != UpdateStep::kLandmarks) {
    EXPECT_GT(row.model_cost_change, 0.0);
    EXPECT_NEAR(row.relative_decrease, row.cost_change / row.model_cost_change,
                1e-9 * std::fabs(row.relative_decrease));
    EXPECT_GE(row.linear_solver_iterations, 1);
  }
}

TEST(UpdateTrace, RowsTellOfTheWholeUpdate) {
  Kinds kinds;
  for (const IncrementalOptions& options : Ways()) {
    const auto loss = std::make_shared<HuberLoss>(0.2);
    IncrementalBundle bundle(options, 12);
    bundle.Grow(10, 60, 3, loss);
    for (int round = 0; round < 4; ++round) {
      const UpdateSummary summary = bundle.solver.Update();
      ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      ExpectSumsOf(summary, bundle.num_factors(), &kinds);
      const std::vector<UpdateIteration>& rows = summary.iterations;
      ASSERT_GT(rows.size(), 1U);
      EXPECT_EQ(rows[0].step, UpdateStep::kNone);
      EXPECT_TRUE(rows[0].step_is_successful);
      EXPECT_EQ(rows[0].cost, summary.initial_cost);
      for (std::size_t k = 1; k < rows.size(); ++k) {
        ExpectConsistent(rows[k], rows[k - 1]);
      }
      EXPECT_NEAR(rows.back().cost, summary.final_cost, 1e-9 * summary.final_cost);
      EXPECT_LE(rows.back().cumulative_time_in_seconds, summary.seconds);
      // Outliers, for landmarks to step by themselves.
      bundle.SetValues(bundle.landmarks()[static_cast<std::size_t>(round)], {4.0, -4.0, 4.0});
      bundle.Grow(1, 8, 3, loss);
    }
  }
  EXPECT_GT(kinds.batch, 3);
  EXPECT_GT(kinds.frames, 3);
  EXPECT_GT(kinds.landmarks, 0);
}

TEST(UpdateTrace, OfAnUpdateWithNothingToDo) {
  IncrementalBundle bundle(IncrementalOptions(), 8);
  bundle.Grow(6, 30, 3);
  bundle.solver.Update();
  const UpdateSummary idle = bundle.solver.Update();
  ASSERT_EQ(idle.iterations.size(), 1U);
  EXPECT_EQ(idle.iterations[0].cost, idle.final_cost);
  EXPECT_EQ(idle.iterations[0].num_evaluated_factors, 0);
}

TEST(UpdateObserver, SeesEveryRowAndTheBestStateSoFar) {
  for (const IncrementalOptions& options : Ways()) {
    IncrementalBundle bundle(options, 12);
    bundle.Grow(10, 60, 3);
    std::vector<UpdateIteration> seen;
    std::vector<std::vector<double>> states;
    const std::vector<double> start = bundle.Values();
    Watcher watcher([&](const UpdateIteration& row) {
      seen.push_back(row);
      states.push_back(bundle.Values());
      return ObserverAction::kContinue;
    });
    UpdateSummary summary;
    bundle.solver.Update(&summary, &watcher);
    ASSERT_EQ(seen.size(), summary.iterations.size());
    EXPECT_EQ(states[0], start);
    EXPECT_EQ(states.back(), bundle.Values());
    for (std::size_t k = 1; k < seen.size(); ++k) {
      EXPECT_EQ(seen[k].iteration, static_cast<int>(k));
      EXPECT_EQ(seen[k].cost, summary.iterations[k].cost);
      EXPECT_GT(seen[k].gradient_max_norm, 0.0);
      EXPECT_GE(seen[k].gradient_norm, seen[k].gradient_max_norm);
      EXPECT_EQ(states[k] != states[k - 1], seen[k].step_is_successful) << "iteration " << k;
    }
    EXPECT_LT(seen.back().gradient_max_norm, 1e-2 * seen[0].gradient_max_norm);
    // An observer that only looks changes nothing.
    IncrementalBundle alone(options, 12);
    alone.Grow(10, 60, 3);
    EXPECT_EQ(alone.solver.Update().final_cost, summary.final_cost);
  }
}

class WatchedUpdate : public testing::TestWithParam<bool> {};

TEST_P(WatchedUpdate, MayBeEndedAndKeepsTheState) {
  for (const IncrementalOptions& options : Ways()) {
    IncrementalBundle bundle(options, 12);
    bundle.Grow(10, 60, 3);
    const auto ends_at_second = [](const UpdateIteration& row) {
      return row.iteration == 2 ? ObserverAction::kTerminateSuccessfully
                                : ObserverAction::kContinue;
    };
    const UpdateSummary stopped = UpdateWatched(GetParam(), ends_at_second, options, &bundle);
    EXPECT_EQ(stopped.termination, Termination::kUserSuccess);
    EXPECT_EQ(stopped.message, "User callback returned SOLVER_TERMINATE_SUCCESSFULLY.");
    EXPECT_EQ(stopped.iterations.size(), 3U);
    EXPECT_LT(stopped.final_cost, stopped.initial_cost);
    const UpdateSummary next = bundle.solver.Update();
    EXPECT_NEAR(next.initial_cost, stopped.final_cost, 1e-9 * stopped.final_cost)
        << "it goes on from there";
    EXPECT_EQ(next.termination, Termination::kConvergence);
  }
}

TEST_P(WatchedUpdate, AbortedPutsTheValuesBack) {
  for (const IncrementalOptions& options : Ways()) {
    for (const int at : {0, 3}) {
      IncrementalBundle bundle(options, 12);
      bundle.Grow(10, 60, 3);
      IncrementalBundle undisturbed(options, 12);
      undisturbed.Grow(10, 60, 3);
      const auto aborts = [at](const UpdateIteration& row) {
        return row.iteration == at ? ObserverAction::kAbort : ObserverAction::kContinue;
      };
      const UpdateSummary aborted = UpdateWatched(GetParam(), aborts, options, &bundle);
      EXPECT_EQ(aborted.termination, Termination::kUserFailure);
      EXPECT_EQ(aborted.message, "User callback returned SOLVER_ABORT.");
      EXPECT_EQ(aborted.final_cost, aborted.initial_cost);
      EXPECT_EQ(bundle.Values(), undisturbed.Values());
      const UpdateSummary next = bundle.solver.Update();
      const UpdateSummary expected = undisturbed.solver.Update();
      EXPECT_EQ(next.iterations.size(), expected.iterations.size()) << "as if it had never begun";
      EXPECT_EQ(next.final_cost, expected.final_cost);
    }
  }
}

TEST_P(WatchedUpdate, IsWatchedWithNothingToDo) {
  const IncrementalOptions options;
  IncrementalBundle bundle(options, 8);
  bundle.Grow(6, 30, 3);
  const double cost = bundle.solver.Update().final_cost;
  const auto aborts = [](const UpdateIteration&) { return ObserverAction::kAbort; };
  const UpdateSummary summary = UpdateWatched(GetParam(), aborts, options, &bundle);
  EXPECT_EQ(summary.termination, Termination::kUserFailure);
  EXPECT_EQ(summary.final_cost, cost);
}

INSTANTIATE_TEST_SUITE_P(ByCallback, WatchedUpdate, testing::Bool());

}  // namespace
}  // namespace inceres
