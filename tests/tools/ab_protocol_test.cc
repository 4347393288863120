#include "tools/ab/ab_protocol.h"

#include <memory>

#include <gtest/gtest.h>

namespace inceres::tools {
namespace {

// A solver whose runs take the given seconds, one after the other (the first is the pre-pass), and
// write down that they ran.
class FakeSolver {
 public:
  FakeSolver(std::string name, std::vector<double> seconds, double final_cost, std::string* log)
      : name_(std::move(name)), seconds_(std::move(seconds)), final_cost_(final_cost), log_(log) {}

  Contender MakeContender(const std::string& solver) {
    return {solver, name_,
            [this](std::optional<int> limit, RunOutcome* outcome) { return Run(limit, outcome); }};
  }

  SolveRecord record;  // what every run returns but for the seconds
  int failing_run = -1;

 private:
  Status Run(std::optional<int> limit, RunOutcome* outcome) {
    *log_ += name_ + (limit ? "*" : "") + " ";
    outcome->record = record;
    outcome->record.usable = next_ != failing_run;
    outcome->record.termination = outcome->record.usable ? "CONVERGENCE" : "FAILURE";
    outcome->record.initial_cost = 100.0;
    outcome->record.final_cost = final_cost_;
    outcome->record.iterations = 4;
    outcome->record.seconds = seconds_.at(static_cast<std::size_t>(next_));
    outcome->parameters = {static_cast<double>(next_)};
    ++next_;
    return Status::Ok();
  }

  std::string name_;
  std::vector<double> seconds_;
  double final_cost_;
  std::string* log_;
  int next_ = 0;
};

class RunComparisonTest : public testing::Test {
 protected:
  Status Compare(bool drop_slow = true) {
    AbOptions options;
    options.repeats = 2;
    options.drop_slow = drop_slow;
    return RunComparison(
        ours_.MakeContender("inceres"),
        {a_.MakeContender("ceres"), b_.MakeContender("ceres"), slow_.MakeContender("ceres")},
        options, [this](const std::string& line) { announced_ += line + "\n"; }, &result_);
  }

  std::string log_;
  std::string announced_;
  FakeSolver ours_{"ours", {9.0, 1.0, 3.0}, 10.0, &log_};
  FakeSolver a_{"a", {1.0, 4.0, 4.0}, 10.0, &log_};
  FakeSolver b_{"b", {1.2, 2.0, 4.0}, 8.0, &log_};
  FakeSolver slow_{"slow", {2.6, 7.0, 7.0}, 10.0, &log_};
  AbResult result_;
};

TEST_F(RunComparisonTest, InterleavesRoundsAfterAPrePass) {
  ASSERT_TRUE(Compare().ok());
  EXPECT_EQ(log_, "ours* a* b* slow* ours a b ours a b ");
}

TEST_F(RunComparisonTest, DropsTheHopelessAndSaysSo) {
  ASSERT_TRUE(Compare().ok());
  ASSERT_EQ(result_.dropped.size(), 1U);
  EXPECT_EQ(result_.dropped[0].configuration, "slow");
  EXPECT_NE(announced_.find("dropped ceres slow: hopelessly slow: 2600 ms"), std::string::npos)
      << announced_;
  EXPECT_EQ(result_.stock.size(), 2U);
}

TEST_F(RunComparisonTest, KeepsWhatWasChosenByHand) {
  ASSERT_TRUE(Compare(false).ok());
  EXPECT_EQ(result_.stock.size(), 3U);
  EXPECT_TRUE(result_.dropped.empty());
}

TEST_F(RunComparisonTest, ComparesWithTheFastestStockRoundByRound) {
  ASSERT_TRUE(Compare().ok());
  EXPECT_EQ(result_.FastestStock().configuration, "b");
  const Spread ratio = result_.RatioToBestStock();
  EXPECT_DOUBLE_EQ(ratio.min, 0.5);
  EXPECT_DOUBLE_EQ(ratio.max, 0.75);
  EXPECT_DOUBLE_EQ(ratio.median, 0.625);
  EXPECT_DOUBLE_EQ(result_.ours.Seconds().median, 2.0);
  EXPECT_DOUBLE_EQ(result_.ours.SecondsPerIteration(), 0.5);
  EXPECT_EQ(result_.ours.parameters,
            std::vector<double>{1.0});  // of the first round, not of the pre-pass
}

TEST_F(RunComparisonTest, CostDifferenceIsAgainstTheLowestStockCost) {
  ASSERT_TRUE(Compare().ok());
  EXPECT_DOUBLE_EQ(result_.RelativeCostDifference(), 0.25);
  EXPECT_EQ(result_.LowestCost(), 8.0);
}

TEST_F(RunComparisonTest, StockInDisguiseIsNoMeasurement) {
  ours_.record.used_stock = true;
  ours_.record.fallback_reason = "bounds";
  const Status status = Compare();
  EXPECT_EQ(status.code, StatusCode::kUnavailable);
  EXPECT_NE(status.message.find("NO MEASUREMENT"), std::string::npos);
  EXPECT_NE(status.message.find("bounds"), std::string::npos);
  EXPECT_EQ(log_, "ours* ");
}

TEST_F(RunComparisonTest, OurFailureIsAnError) {
  ours_.failing_run = 2;
  EXPECT_EQ(Compare().code, StatusCode::kEvaluationFailed);
}

TEST_F(RunComparisonTest, AStockRunThatFailsInARoundIsTakenOut) {
  b_.failing_run = 1;
  ASSERT_TRUE(Compare().ok());
  ASSERT_EQ(result_.stock.size(), 1U);
  EXPECT_EQ(result_.FastestStock().configuration, "a");
  ASSERT_EQ(result_.dropped.size(), 2U);
  EXPECT_EQ(result_.dropped[1].configuration, "b");
}

TEST_F(RunComparisonTest, WithoutAnyStockRunThereIsNothingToCompare) {
  AbOptions options;
  EXPECT_EQ(RunComparison(
                ours_.MakeContender("inceres"), {}, options, [](const std::string&) {}, &result_)
                .code,
            StatusCode::kEvaluationFailed);
}

TEST(RelativeCostDifference, CostsAtRoundingLevelAreEqual) {
  AbResult result;
  SolveRecord record;
  record.initial_cost = 1.0;
  record.final_cost = 1e-25;
  result.ours.rounds = {record};
  record.final_cost = 0.0;
  result.stock = {{"ceres", "a", {record}, {}}};
  EXPECT_EQ(result.RelativeCostDifference(), 0.0);
}

}  // namespace
}  // namespace inceres::tools
