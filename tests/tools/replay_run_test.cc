// A replay in lockstep: all ways to solve see the same problem; failures and excesses are counted,
// not hidden.
#include "tools/replay/replay_run.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "tools/ab/statistics.h"
#include "tools/replay/replay_ceres_problem.h"
#include "tools/replay/replay_flatness.h"
#include "tools/replay/replay_graph.h"
#include "tools/replay/replay_report.h"
#include "tools/replay/replay_scripts.h"
#include "tools/small_keyframes.h"
#include "tools/small_problems.h"
#include "tools/small_replays.h"

namespace inceres::tools {
namespace {

std::vector<ReplayScript> Scripts() {
  BalReplayOptions free;
  free.free_intrinsics = true;
  ReplayScript planar, spatial;
  EXPECT_TRUE(MakePoseGraphReplay(NoisyPoseGraph(2, 26), &planar).ok());
  EXPECT_TRUE(MakePoseGraphReplay(NoisyPoseGraph(3, 26), &spatial).ok());
  return {MakeBalReplay(SmallBal(6, 40), {}),
          MakeBalReplay(SmallBal(6, 40), free),
          MakeKeyframeReplay(SmallKeyframes(13)),
          MakeStereoReplay(SmallStereo(16)),
          planar,
          spatial};
}

std::vector<ReplayRow> Play(const ReplayScript& script, ReplaySettings settings, ReplaySolver* ours,
                            int max_steps = 0) {
  settings.dogleg = script.dogleg;
  settings.linear_solver =
      HasLandmarks(script) ? ceres::DENSE_SCHUR : ceres::SPARSE_NORMAL_CHOLESKY;
  const std::unique_ptr<ReplaySolver> stock = MakeStockReplaySolver(settings);
  ReplayReference judge(settings);
  std::vector<ReplayRow> rows;
  int calls = 0;
  const Status status = RunReplay(
      script, {max_steps, true}, ours, stock.get(), nullptr, &judge,
      [&](const ReplayRow& row) { EXPECT_EQ(row.step, ++calls); }, &rows);
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
      settings.linear_solver =
          HasLandmarks(script) ? ceres::DENSE_SCHUR : ceres::SPARSE_NORMAL_CHOLESKY;
      settings.function_tolerance = 1e-9;
      const std::unique_ptr<ReplaySolver> ours = MakeExactReplaySolver(settings);
      const std::vector<ReplayRow> rows = Play(script, settings, ours.get());
      ASSERT_EQ(rows.size(), script.steps.size());
      for (const ReplayRow& row : rows) {
        ASSERT_TRUE(row.ours.outcome.usable) << row.ours.outcome.message;
        ASSERT_TRUE(row.stock->outcome.usable) << row.stock->outcome.message;
        // one edge, which the first pose that moves starts along
        const bool solved = row.ours.outcome.initial_cost < 1e-20;
        EXPECT_TRUE(solved || row.ours.cost < row.ours.outcome.initial_cost);
        EXPECT_NEAR(row.ours.outcome.final_cost, row.ours.cost, 1e-9 * row.ours.cost)
            << "what it reports is not its state's cost";
        EXPECT_NEAR(row.stock->outcome.final_cost, row.stock->cost, 1e-9 * row.stock->cost);
        EXPECT_NEAR(row.ours.outcome.initial_cost, row.stock->outcome.initial_cost,
                    1e-4 * row.stock->outcome.initial_cost);
        EXPECT_NEAR(row.ours.cost, row.stock->cost, 1e-6 * row.stock->cost);
        ASSERT_TRUE(row.RelativeCostExcess().has_value());
        EXPECT_LT(std::fabs(*row.RelativeCostExcess()), 1e-6);
        EXPECT_TRUE(solved || row.ours.outcome.iterations > 0);
      }
    }
  }
}

// The solver that remembers, against the minimum that stock reaches from the same state at
// tolerances of 1e-12.
class IncrementalReplay : public testing::TestWithParam<bool> {};

TEST_P(IncrementalReplay, StaysWithinItsToleranceOfTheMinimum) {
  const bool autodiff = GetParam();
  for (const ReplayScript& script : Scripts()) {
    ReplaySettings settings;
    settings.function_tolerance = 1e-8;
    settings.parameter_tolerance = 0.0;
    settings.autodiff = autodiff;
    const std::unique_ptr<ReplaySolver> ours = MakeIncrementalReplaySolver(settings);
    EXPECT_NE(ours->Name().find(autodiff ? "AutoDiff" : "analytic"), std::string::npos);
    const std::vector<ReplayRow> rows = Play(script, settings, ours.get());
    ASSERT_EQ(rows.size(), script.steps.size());
    for (const ReplayRow& row : rows) {
      ASSERT_TRUE(row.ours.outcome.usable) << row.ours.outcome.message;
      EXPECT_NEAR(row.ours.outcome.final_cost, row.ours.cost, 1e-9 * row.ours.cost)
          << "what it reports is not its state's cost";
      ASSERT_TRUE(row.RelativeCostExcess().has_value());
      EXPECT_LT(*row.RelativeCostExcess(), settings.function_tolerance) << "step " << row.step;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(AnalyticAndAutoDiff, IncrementalReplay, testing::Bool());

TEST(Replay, APriorWithoutAnAutoDiffVersionIsAnError) {
  ReplayStep step;
  step.variables.emplace_back();  // a point
  step.factors.push_back({DiagonalPriorFamily::Measurement{{1.0, 2.0}, {1.0, 1.0}}, {0}, {}});
  FactorGraph graph;
  EXPECT_EQ(ReplayGraph(true).Add(step, &graph).message,
            "factor 0 of the step: it has no AutoDiff version");
  EXPECT_FALSE(ReplayCeresProblem(true).Add(step).ok());
  FactorGraph other;
  EXPECT_TRUE(ReplayGraph(false).Add(step, &other).ok());
}

TEST(Replay, WithoutStockTheJudgeLooksAtTheLastStep) {
  const ReplayScript script = MakeBalReplay(SmallBal(6, 40), {});
  const std::unique_ptr<ReplaySolver> ours = MakeExactReplaySolver({});
  ReplayReference judge({});
  std::vector<ReplayRow> rows;
  const Status status = RunReplay(
      script, {0, false}, ours.get(), nullptr, nullptr, &judge, [](const ReplayRow&) {}, &rows);
  ASSERT_TRUE(status.ok()) << status.message;
  ASSERT_EQ(rows.size(), 5u);
  for (const ReplayRow& row : rows) {
    EXPECT_FALSE(row.stock.has_value());
    EXPECT_FALSE(row.optimum_cost.has_value());
    EXPECT_NEAR(row.ours.cost, row.ours.outcome.final_cost, 1e-12 * row.ours.cost);
  }
  EXPECT_EQ(rows[3].ours.cost, rows[3].ours.outcome.final_cost);
  EXPECT_EQ(rows[4].ours.cost, judge.CostAt(ours->State()));
  const ReplaySummary summary = Summarize(rows, 1e-6);
  EXPECT_FALSE(summary.stock.has_value());
  EXPECT_FALSE(summary.ratio_total.has_value());
  const nlohmann::json json = ReplayJson({}, summary, rows);
  EXPECT_TRUE(json["stock_ms"].is_null());
  EXPECT_TRUE(json["rows"][0]["stock"].is_null());
  EXPECT_TRUE(json["failed_steps"]["stock"].is_null());
}

TEST(Replay, GraphAndCeresProblemAgreeOnTheStateAndItsCost) {
  for (const ReplayScript& script : Scripts()) {
    FactorGraph graph, autodiff_graph, edited;
    ReplayGraph growing(false), autodiff_growing(true), editing(false);
    const auto add_family = [&](auto family) { return edited.AddFamily(std::move(family)); };
    const auto value = [&](VariableId id) { return edited.Values(id); };
    const auto apply = [&](const GraphEdit& edit) { return edited.Apply(edit); };
    ReplayCeresProblem analytic(false), autodiff(true);
    int factors = 0;
    for (const ReplayStep& step : script.steps) {
      ASSERT_TRUE(growing.Add(step, &graph).ok());
      ASSERT_TRUE(autodiff_growing.Add(step, &autodiff_graph).ok());
      ASSERT_TRUE(editing.AddAsEdit(step, edited, value, add_family, apply).ok());
      ASSERT_TRUE(analytic.Add(step).ok());
      ASSERT_TRUE(autodiff.Add(step).ok());
      factors += static_cast<int>(step.factors.size());
    }
    EXPECT_TRUE(graph.Validate().ok()) << graph.Validate().message;
    EXPECT_TRUE(autodiff_graph.Validate().ok()) << autodiff_graph.Validate().message;
    EXPECT_EQ(graph.num_factors(), factors);
    EXPECT_EQ(autodiff_graph.num_factors(), factors);
    EXPECT_EQ(autodiff_graph.state(), graph.state());
    EXPECT_TRUE(edited.Validate().ok()) << edited.Validate().message;
    EXPECT_EQ(edited.num_factors(), factors);
    EXPECT_EQ(edited.state(), graph.state());
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

    EXPECT_EQ(Solve({}, &edited).final_cost, Solve({}, &graph).final_cost)
        << "not the same problem";
  }
}

// Never moves, and fails every other step.
class LazySolver : public ReplaySolver {
 public:
  std::string Name() const override { return "lazy"; }
  Status AddStep(const ReplayStep& step) override {
    EXPECT_TRUE(growing_.Add(step, &graph_).ok());
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
  ReplayGraph growing_{false};
  int steps_ = 0;
};

TEST(Replay, ASolverThatDoesNothingIsFoundOut) {
  LazySolver lazy;
  const std::vector<ReplayRow> rows = Play(MakeKeyframeReplay(SmallKeyframes(13)), {}, &lazy, 4);
  ASSERT_EQ(rows.size(), 4u);
  const ReplaySummary summary = Summarize(rows, 1e-6);
  EXPECT_EQ(summary.steps, 4);
  EXPECT_EQ(summary.ours.failed, (std::vector<int>{2, 4}));
  ASSERT_TRUE(summary.stock.has_value());
  EXPECT_TRUE(summary.stock->failed.empty());
  EXPECT_EQ(summary.in_excess, (std::vector<int>{1, 2, 3, 4}));
  EXPECT_EQ(summary.ours_lower, 0);
  EXPECT_EQ(summary.stock_lower, 4);
  ASSERT_TRUE(summary.max_relative_cost_excess.has_value());
  EXPECT_GT(*summary.max_relative_cost_excess, 0.1);
  EXPECT_DOUBLE_EQ(summary.ours.ms.median, 2.5);
  EXPECT_DOUBLE_EQ(summary.ours.ms.p95, 4.0);
  EXPECT_DOUBLE_EQ(summary.ours.ms.max, 4.0);
  EXPECT_DOUBLE_EQ(summary.ours.ms.total, 10.0);
  EXPECT_DOUBLE_EQ(*summary.ratio_total, 10.0 / summary.stock->ms.total);
  EXPECT_DOUBLE_EQ(*summary.ratio_median, 2.5 / summary.stock->ms.median);
  EXPECT_NE(ReplayTableLine(rows[1]).find("ours failed: no wish to"), std::string::npos);
  EXPECT_EQ(ReplayTableLine(rows[0]).find("failed"), std::string::npos);

  const nlohmann::json json = ReplayJson({}, summary, rows);
  EXPECT_EQ(json["failed_steps"]["ours"], 2);
  EXPECT_EQ(json["ours_steps"]["failed"], (std::vector<int>{2, 4}));
  EXPECT_EQ(json["steps_in_excess"].size(), 4u);
  EXPECT_EQ(json["rows"].size(), 4u);
  EXPECT_EQ(json["rows"][1]["ours"]["usable"], false);
  EXPECT_EQ(json["ours_ms"]["total"], summary.ours.ms.total);
}

TEST(Replay, BesideBatchAndCheckpoints) {
  const ReplayScript script = MakeKeyframeReplay(SmallKeyframes(13));
  ReplaySettings settings;
  settings.dogleg = script.dogleg;
  const std::unique_ptr<ReplaySolver> ours = MakeIncrementalReplaySolver(settings);
  const std::unique_ptr<ReplaySolver> batch = MakeExactReplaySolver(settings);
  ReplayReference judge(settings);
  ReplayRunOptions options;
  options.checkpoints = 3;
  std::vector<ReplayRow> rows;
  const Status status = RunReplay(
      script, options, ours.get(), nullptr, batch.get(), &judge, [](const ReplayRow&) {}, &rows);
  ASSERT_TRUE(status.ok()) << status.message;
  int num_optima = 0;
  for (const ReplayRow& row : rows) {
    num_optima += row.optimum_cost.has_value() ? 1 : 0;
    ASSERT_TRUE(row.batch.has_value());
    EXPECT_TRUE(row.batch->usable);
    // the same graph, from where ours began
    EXPECT_NEAR(row.batch->initial_cost, row.ours.outcome.initial_cost,
                1e-9 * row.ours.outcome.initial_cost + 1e-12);
  }
  EXPECT_EQ(num_optima, 3);
  EXPECT_TRUE(rows.back().optimum_cost.has_value());
  rows[0].batch->processor_seconds = 1.0;
  rows[0].ours.outcome.processor_seconds = 3.0;
  rows[1].batch->processor_seconds = rows[1].ours.outcome.processor_seconds = 1e-9;
  const std::vector<ReplayRow> two(rows.begin(), rows.begin() + 2);
  const ReplaySummary summary = Summarize(two, 1e-6);
  ASSERT_TRUE(summary.beside_batch.has_value());
  EXPECT_EQ(summary.beside_batch->within, 0.5);
  EXPECT_EQ(summary.beside_batch->worst, 3.0);
  EXPECT_EQ(summary.beside_batch->worst_step, 1);
  EXPECT_EQ(summary.beside_batch->num_above_twice, 1);
}

TEST(Replay, AStepThatCannotBeAddedEndsIt) {
  LazySolver lazy;
  const ReplayScript script = MakeKeyframeReplay(SmallKeyframes(13));
  const std::unique_ptr<ReplaySolver> stock = MakeStockReplaySolver({});
  ReplayReference judge({});
  std::vector<ReplayRow> rows;
  const Status status = RunReplay(
      script, {}, &lazy, stock.get(), nullptr, &judge, [](const ReplayRow&) {}, &rows);
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
  // began there: not the rounding of anything larger
  row.ours.outcome.initial_cost = row.ours.cost;
  EXPECT_GT(*row.RelativeCostExcess(), 1e3);
  row.num_factors = 2;  // residuals of 1e-10 standard deviations
  EXPECT_EQ(*row.RelativeCostExcess(), 0.0);
  EXPECT_EQ(row.Rounding(), 2e-20);
}

TEST(Replay, RoundingIsNoDifferenceBetweenSides) {
  ReplayRow row;
  row.num_factors = 100;
  row.stock.emplace();
  row.ours.outcome.usable = row.stock->outcome.usable = true;
  row.ours.cost = 1e-24;
  row.ours.outcome.final_cost = 2e-24;
  row.stock->cost = row.stock->outcome.final_cost = 1e-22;
  ReplaySummary summary = Summarize(std::vector<ReplayRow>{row}, 1e-6);
  EXPECT_EQ(summary.ours_lower, 0);
  EXPECT_LE(summary.ours.max_report_error, 1e-6);
  row.stock->cost = row.stock->outcome.final_cost = 1e-16;
  row.ours.outcome.final_cost = 1e-17;
  summary = Summarize(std::vector<ReplayRow>{row}, 1e-6);
  EXPECT_EQ(summary.ours_lower, 1);
  EXPECT_GT(summary.ours.max_report_error, 1.0);
}

TEST(Replay, SummaryWithoutOptimumOrLoop) {
  ReplayRow row;
  row.stock.emplace();
  row.ours.outcome.seconds = row.stock->outcome.seconds = 1.0;
  ReplaySummary summary = Summarize(std::vector<ReplayRow>{row}, 1e-6);
  EXPECT_FALSE(summary.max_relative_cost_excess.has_value());
  EXPECT_FALSE(summary.worst_loop_ratio.has_value());
  EXPECT_TRUE(ReplayJson({}, summary, {row})["max_relative_cost_excess"].is_null());
  row.closes_loop = true;
  row.ours.outcome.seconds = 0.25;
  summary = Summarize(std::vector<ReplayRow>{row}, 1e-6);
  EXPECT_DOUBLE_EQ(*summary.worst_loop_ratio, 0.25);
  EXPECT_NE(ReplayTableLine(row).find("loop"), std::string::npos);
}

TEST(Replay, SummaryNamesWhatWentWrong) {
  std::vector<ReplayRow> rows(3);
  for (ReplayRow& row : rows) {
    row.stock.emplace();
    for (ReplaySide* side : {&row.ours, &*row.stock}) {
      side->outcome.usable = true;
      side->outcome.termination = "CONVERGENCE";
      side->outcome.iterations = 4;
      side->cost = side->outcome.final_cost = 1.0;
    }
  }
  rows[1].stock->outcome.termination = "NO_CONVERGENCE";
  rows[1].stock->outcome.work = {{"invalid_steps", 3}};
  rows[1].stock->cost = 2.0;
  rows[2].stock->outcome.usable = false;
  rows[2].stock->cost = std::nan("");
  rows[2].ours.cost = 1.1;
  const ReplaySummary summary = Summarize(rows, 1e-6);
  EXPECT_EQ(summary.ours_lower, 2) << "a cost that cannot be evaluated is not lower";
  EXPECT_EQ(summary.stock_lower, 0);
  EXPECT_EQ(summary.stock->unconverged, 1);
  EXPECT_EQ(summary.stock->invalid_steps, 3);
  EXPECT_EQ(summary.stock->iterations, 12);
  EXPECT_DOUBLE_EQ(summary.stock->max_report_error, 0.5);
  EXPECT_NEAR(summary.ours.max_report_error, 0.1 / 1.1, 1e-15);
  const std::string text = ReplaySummaryText({}, summary);
  EXPECT_NE(text.find("stock: 1 steps whose solve failed: 3\n"), std::string::npos) << text;
  EXPECT_NE(text.find("stock: 1 steps ended before they converged\n"), std::string::npos);
  EXPECT_NE(text.find("stock: 3 iterations of 12 whose linear solve or evaluation failed\n"),
            std::string::npos);
  EXPECT_NE(text.find("ours: reports a cost that is not its state's"), std::string::npos);
  EXPECT_EQ(text.find("ours: 1 steps"), std::string::npos);
}

TEST(Replay, StepList) {
  EXPECT_EQ(StepList({}), "");
  EXPECT_EQ(StepList({3, 5, 7, 8, 9, 12, 13}), "3, 5, 7-9, 12-13");
  std::vector<int> many;
  for (int k = 0; k < 20; ++k) {
    many.push_back(2 * k);
  }
  EXPECT_EQ(StepList(many), "0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, ... (20 in all)");
}

// Latencies and counts that are the step's number; bytes that grow with it.
TEST(Replay, Flatness) {
  std::vector<ReplayRow> rows;
  for (int step = 1; step <= 400; ++step) {
    ReplayRow row;
    row.step = step;
    row.ours.outcome.seconds = 1e-3 * step;
    row.ours.growth_seconds = 2e-3;
    row.ours.outcome.iterations = 3;
    row.ours.outcome.work = {{"visits", 10 * step}, {"rejected", 0}, {"bytes", 1000 * step}};
    rows.push_back(row);
  }
  const ReplayFlatness flatness = MeasureFlatness(rows);
  EXPECT_EQ(flatness.early.first, 150);
  EXPECT_EQ(flatness.early.last, 250);
  EXPECT_EQ(flatness.late.first, 301);
  EXPECT_EQ(flatness.late.last, 400);
  EXPECT_NEAR(flatness.early.ms, 200.0, 1e-9);
  EXPECT_NEAR(flatness.late.ms, 350.5, 1e-9);
  EXPECT_NEAR(*flatness.late.bytes_per_step, 1000.0, 1e-9);
  const nlohmann::json json = FlatnessJson(flatness);
  EXPECT_NEAR(json["growth_percent"]["ms"].get<double>(), 75.25, 1e-9);
  EXPECT_NEAR(json["growth_percent"]["work"]["visits"].get<double>(), 75.25, 1e-9);
  EXPECT_TRUE(json["growth_percent"]["work"]["rejected"].is_null());
  EXPECT_EQ(json["growth_percent"]["iterations"], 0.0);
  EXPECT_NEAR(json["growth_percent"]["bytes_per_step"].get<double>(), 0.0, 1e-9);
  EXPECT_FALSE(json["early"]["work"].contains("bytes"));
  const std::string text = FlatnessText(flatness);
  EXPECT_NE(text.find("visits                                   2000           3505     +75.2 %\n"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("150-250        301-400"), std::string::npos);
}

TEST(Replay, FlatnessFindsCountsByName) {
  std::vector<ReplayRow> rows(400);
  for (int step = 1; step <= 400; ++step) {
    ReplayOutcome& outcome = rows[static_cast<std::size_t>(step - 1)].ours.outcome;
    outcome.work = {{"visits", 10}, {"newest", step > 300 ? 30 : 20}};
    if (step % 3 == 0) {  // the last step among those without it
      outcome.work.insert(outcome.work.begin(), {"any", 5});
    }
  }
  const nlohmann::json json = FlatnessJson(MeasureFlatness(rows));
  for (const char* window : {"early", "late"}) {
    EXPECT_EQ(json[window]["work"]["any"], 5.0);
    EXPECT_EQ(json[window]["work"]["visits"], 10.0);
  }
  EXPECT_EQ(json["growth_percent"]["work"]["any"], 0.0);
  EXPECT_EQ(json["growth_percent"]["work"]["newest"], 50.0);
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
