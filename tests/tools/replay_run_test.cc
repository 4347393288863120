// A replay in lockstep: all ways to solve see the same problem; failures and excesses are counted, not hidden.
#include "tools/common/replay_run.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "tools/common/replay_ceres_problem.h"
#include "tools/common/replay_graph.h"
#include "tools/common/replay_report.h"
#include "tools/common/replay_scripts.h"
#include "tools/common/statistics.h"
#include "tools/small_keyframes.h"
#include "tools/small_problems.h"

namespace inceres::tools {
namespace {

std::vector<ReplayScript> Scripts() {
  BalReplayOptions free;
  free.free_intrinsics = true;
  return {MakeBalReplay(SmallBal(6, 40), {}), MakeBalReplay(SmallBal(6, 40), free), MakeKeyframeReplay(SmallKeyframes(13))};
}

std::vector<ReplayRow> Play(const ReplayScript& script, ReplaySettings settings, ReplaySolver* ours, int max_steps = 0) {
  settings.dogleg = script.dogleg;
  const std::unique_ptr<ReplaySolver> stock = MakeStockReplaySolver(settings);
  ReplayReference judge(settings);
  std::vector<ReplayRow> rows;
  int calls = 0;
  const Status status = RunReplay(
      script, {max_steps, true}, ours, stock.get(), &judge, [&](const ReplayRow& row) { EXPECT_EQ(row.step, ++calls); }, &rows);
  EXPECT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(static_cast<int>(rows.size()), calls);
  return rows;
}

TEST(Replay, OursAndStockGoThroughTheSameCosts) {
  for (const ReplayScript& script : Scripts()) {
    for (const bool autodiff : {false, true}) {
      ReplaySettings settings;
      settings.autodiff = autodiff;
      settings.dogleg = script.dogleg;
      settings.function_tolerance = 1e-9;
      const std::unique_ptr<ReplaySolver> ours = MakeExactReplaySolver(settings);
      const std::vector<ReplayRow> rows = Play(script, settings, ours.get());
      ASSERT_EQ(rows.size(), script.steps.size());
      for (const ReplayRow& row : rows) {
        ASSERT_TRUE(row.ours.outcome.usable) << row.ours.outcome.message;
        ASSERT_TRUE(row.stock.outcome.usable) << row.stock.outcome.message;
        EXPECT_LT(row.ours.cost, row.ours.outcome.initial_cost);
        EXPECT_NEAR(row.ours.outcome.final_cost, row.ours.cost, 1e-9 * row.ours.cost)
            << "what it reports is not its state's cost";
        EXPECT_NEAR(row.stock.outcome.final_cost, row.stock.cost, 1e-9 * row.stock.cost);
        EXPECT_NEAR(row.ours.outcome.initial_cost, row.stock.outcome.initial_cost, 1e-4 * row.stock.outcome.initial_cost);
        EXPECT_NEAR(row.ours.cost, row.stock.cost, 1e-6 * row.stock.cost);
        ASSERT_TRUE(row.RelativeCostExcess().has_value());
        EXPECT_LT(std::fabs(*row.RelativeCostExcess()), 1e-6);
        EXPECT_GT(row.ours.outcome.iterations, 0);
      }
    }
  }
}

// The solver that remembers, against the minimum that stock reaches from the same state at tolerances of 1e-12.
TEST(Replay, IncrementalStaysWithinItsToleranceOfTheMinimum) {
  for (const ReplayScript& script : Scripts()) {
    ReplaySettings settings;
    settings.function_tolerance = 1e-8;
    settings.parameter_tolerance = 0.0;
    const std::unique_ptr<ReplaySolver> ours = MakeIncrementalReplaySolver(settings);
    const std::vector<ReplayRow> rows = Play(script, settings, ours.get());
    ASSERT_EQ(rows.size(), script.steps.size());
    for (const ReplayRow& row : rows) {
      ASSERT_TRUE(row.ours.outcome.usable) << row.ours.outcome.message;
      EXPECT_NEAR(row.ours.outcome.final_cost, row.ours.cost, 1e-9 * row.ours.cost) << "what it reports is not its state's cost";
      ASSERT_TRUE(row.RelativeCostExcess().has_value());
      EXPECT_LT(*row.RelativeCostExcess(), 1e-6) << "step " << row.step;
    }
  }
}

TEST(Replay, GraphAndCeresProblemAgreeOnTheStateAndItsCost) {
  for (const ReplayScript& script : Scripts()) {
    FactorGraph graph;
    ReplayGraph growing(&graph);
    ReplayCeresProblem analytic(false), autodiff(true);
    int factors = 0;
    for (const ReplayStep& step : script.steps) {
      growing.Add(step);
      ASSERT_TRUE(analytic.Add(step).ok());
      ASSERT_TRUE(autodiff.Add(step).ok());
      factors += static_cast<int>(step.factors.size());
    }
    EXPECT_TRUE(graph.Validate().ok()) << graph.Validate().message;
    EXPECT_EQ(graph.num_factors(), factors);
    EXPECT_EQ(analytic.problem()->NumResidualBlocks(), factors);
    EXPECT_EQ(graph.state(), analytic.State());
    double costs[2];
    ASSERT_TRUE(analytic.problem()->Evaluate({}, &costs[0], nullptr, nullptr, nullptr));
    ASSERT_TRUE(autodiff.problem()->Evaluate({}, &costs[1], nullptr, nullptr, nullptr));
    EXPECT_NEAR(costs[0], costs[1], 1e-12 * costs[0]);

    std::vector<double> moved = analytic.State();
    std::reverse(moved.begin(), moved.end());
    autodiff.SetState(moved);
    EXPECT_EQ(autodiff.State(), moved);
  }
}

// Never moves, and fails every other step.
class LazySolver : public ReplaySolver {
 public:
  std::string Name() const override { return "lazy"; }
  Status AddStep(const ReplayStep& step) override {
    growing_.Add(step);
    return ++steps_ > 4 ? Status::Error(StatusCode::kSingular, "tired") : Status::Ok();
  }
  ReplayOutcome Solve() override {
    ReplayOutcome outcome;
    outcome.usable = steps_ % 2 == 1;
    outcome.message = "no wish to";
    outcome.seconds = 0.001 * steps_;
    return outcome;
  }
  std::vector<double> State() const override { return graph_.state(); }

 private:
  FactorGraph graph_;
  ReplayGraph growing_{&graph_};
  int steps_ = 0;
};

TEST(Replay, ASolverThatDoesNothingIsFoundOut) {
  LazySolver lazy;
  const std::vector<ReplayRow> rows = Play(MakeKeyframeReplay(SmallKeyframes(13)), {}, &lazy, 4);
  ASSERT_EQ(rows.size(), 4u);
  const ReplaySummary summary = Summarize(rows);
  EXPECT_EQ(summary.steps, 4);
  EXPECT_EQ(summary.failed_ours, 2);
  EXPECT_EQ(summary.failed_stock, 0);
  ASSERT_TRUE(summary.max_relative_cost_excess.has_value());
  EXPECT_GT(*summary.max_relative_cost_excess, 0.1);
  EXPECT_DOUBLE_EQ(summary.ours.median, 2.5);
  EXPECT_DOUBLE_EQ(summary.ours.p95, 4.0);
  EXPECT_DOUBLE_EQ(summary.ours.max, 4.0);
  EXPECT_DOUBLE_EQ(summary.ours.total, 10.0);
  EXPECT_DOUBLE_EQ(summary.ratio_total, 10.0 / summary.stock.total);
  EXPECT_DOUBLE_EQ(summary.ratio_median, 2.5 / summary.stock.median);
  EXPECT_NE(ReplayTableLine(rows[1]).find("ours failed: no wish to"), std::string::npos);
  EXPECT_EQ(ReplayTableLine(rows[0]).find("failed"), std::string::npos);

  const nlohmann::json json = ReplayJson({}, summary, rows);
  EXPECT_EQ(json["failed_steps"]["ours"], 2);
  EXPECT_EQ(json["rows"].size(), 4u);
  EXPECT_EQ(json["rows"][1]["ours"]["usable"], false);
  EXPECT_EQ(json["ours_ms"]["total"], summary.ours.total);
}

TEST(Replay, AStepThatCannotBeAddedEndsIt) {
  LazySolver lazy;
  const ReplayScript script = MakeKeyframeReplay(SmallKeyframes(13));
  const std::unique_ptr<ReplaySolver> stock = MakeStockReplaySolver({});
  ReplayReference judge({});
  std::vector<ReplayRow> rows;
  const Status status = RunReplay(
      script, {}, &lazy, stock.get(), &judge, [](const ReplayRow&) {}, &rows);
  EXPECT_EQ(status.code, StatusCode::kSingular);
  EXPECT_EQ(status.message, "step 5: lazy: tired");
  EXPECT_EQ(rows.size(), 4u);
}

TEST(Replay, RelativeCostExcess) {
  ReplayRow row;
  EXPECT_FALSE(row.RelativeCostExcess().has_value());
  row.ours.outcome.initial_cost = 1e3;
  row.ours.cost = 2.0;
  row.optimum_cost = 1.0;
  EXPECT_DOUBLE_EQ(*row.RelativeCostExcess(), 1.0);
  row.ours.cost = 0.5;
  EXPECT_DOUBLE_EQ(*row.RelativeCostExcess(), -0.5);
  row.ours.cost = 1e-20;  // both are rounding of 1e3
  row.optimum_cost = 1e-25;
  EXPECT_EQ(*row.RelativeCostExcess(), 0.0);
}

TEST(Replay, SummaryWithoutOptimumOrLoop) {
  ReplayRow row;
  row.ours.outcome.seconds = row.stock.outcome.seconds = 1.0;
  ReplaySummary summary = Summarize(std::vector<ReplayRow>{row});
  EXPECT_FALSE(summary.max_relative_cost_excess.has_value());
  EXPECT_FALSE(summary.worst_loop_ratio.has_value());
  EXPECT_TRUE(ReplayJson({}, summary, {row})["max_relative_cost_excess"].is_null());
  row.closes_loop = true;
  row.ours.outcome.seconds = 0.25;
  summary = Summarize(std::vector<ReplayRow>{row});
  EXPECT_DOUBLE_EQ(*summary.worst_loop_ratio, 0.25);
  EXPECT_NE(ReplayTableLine(row).find("loop"), std::string::npos);
}

TEST(Statistics, Percentile) {
  std::vector<double> values;
  for (int k = 20; k > 0; --k) {
    values.push_back(k);
  }
  EXPECT_EQ(Percentile(values, 0.95), 19.0);
  EXPECT_EQ(Percentile(values, 0.951), 20.0);
  EXPECT_EQ(Percentile(values, 0.5), 10.0);
  EXPECT_EQ(Percentile(values, 1.0), 20.0);
  EXPECT_EQ(Percentile({7.0}, 0.01), 7.0);
}

}  // namespace
}  // namespace inceres::tools
