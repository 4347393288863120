#include "tools/ab/ab_report.h"

#include <gtest/gtest.h>

#include "tools/ab/statistics.h"

namespace inceres::tools {
namespace {

SolveRecord Record(double seconds, double final_cost) {
  SolveRecord record;
  record.usable = true;
  record.termination = "CONVERGENCE";
  record.initial_cost = 100.0;
  record.final_cost = final_cost;
  record.iterations = 2;
  record.seconds = seconds;
  record.stage_seconds = {{"setup", 0.25 * seconds}, {"total", seconds}};
  record.trace = {{0.1 * seconds, 100.0, true},
                  {0.5 * seconds, 1.005 * final_cost, true},
                  {0.9 * seconds, final_cost, true}};
  return record;
}

class AbReportTest : public testing::Test {
 protected:
  AbReportTest() {
    result_.ours = {
        "inceres", "dense_schur", {Record(1.0, 10.0), Record(2.0, 10.0), Record(3.0, 10.0)}, {}};
    result_.stock = {
        {"ceres", "sparse_schur", {Record(4.0, 10.1), Record(4.0, 10.1), Record(4.0, 10.5)}, {}}};
    result_.dropped = {{"dense_schur", "hopelessly slow"}};
    context_.problem = "bal:street.txt";
    context_.description = "2 cameras";
    context_.threads = 2;
    context_.environment = {{"cpu", "a <cpu>"}, {"blas", "libblas.so"}};
    context_.difference.points = 0.25;
  }
  AbResult result_;
  AbContext context_;
};

TEST_F(AbReportTest, JsonHasTheAgreedFields) {
  const nlohmann::json report = AbJson(context_, result_);
  EXPECT_EQ(report.at("problem"), "bal:street.txt");
  EXPECT_EQ(report.at("threads"), 2);
  ASSERT_EQ(report.at("runs").size(), 2U);
  const nlohmann::json& ours = report.at("runs")[0];
  EXPECT_EQ(ours.at("solver"), "inceres");
  EXPECT_EQ(ours.at("configuration"), "dense_schur");
  EXPECT_EQ(ours.at("seconds").at("median"), 2.0);
  EXPECT_EQ(ours.at("seconds").at("min"), 1.0);
  EXPECT_EQ(ours.at("seconds").at("max"), 3.0);
  EXPECT_EQ(ours.at("stage_seconds"), nlohmann::json({{"setup", 0.5}, {"total", 2.0}}))
      << "medians";
  EXPECT_EQ(ours.at("initial_cost"), 100.0);
  EXPECT_EQ(ours.at("final_cost"), 10.0);
  EXPECT_EQ(ours.at("final_cost_spread"), 0.0);
  EXPECT_NEAR(report.at("runs")[1].at("final_cost_spread").get<double>(), 0.4, 1e-12);
  EXPECT_EQ(ours.at("iterations"), 2);
  EXPECT_EQ(ours.at("termination"), "CONVERGENCE");
  EXPECT_EQ(report.at("ratio_to_best_stock").at("median"), 0.5);
  EXPECT_NEAR(report.at("relative_cost_difference").get<double>(), -0.1 / 10.1, 1e-15);
  EXPECT_EQ(report.at("environment").at("cpu"), "a <cpu>");
  EXPECT_EQ(report.at("dropped")[0].at("configuration"), "dense_schur");
  EXPECT_EQ(report.at("parameter_difference").at("largest"), 0.25);
}

TEST_F(AbReportTest, TimeToGapIsAgainstTheLowestCostOfAllRuns) {
  const nlohmann::json report = AbJson(context_, result_);
  const nlohmann::json& ours = report.at("runs")[0].at("time_to_gap");
  EXPECT_DOUBLE_EQ(ours.at("1e-2").get<double>(), 1.0);  // half of the median run
  EXPECT_DOUBLE_EQ(ours.at("1e-3").get<double>(), 1.8);
  EXPECT_DOUBLE_EQ(ours.at("1e-5").get<double>(), 1.8);
  const nlohmann::json& stock = report.at("runs")[1].at("time_to_gap");
  EXPECT_TRUE(stock.at("1e-3").is_null()) << "the cost of stock stays 1 % above ours";
  EXPECT_TRUE(stock.at("1e-4").is_null());
}

TEST_F(AbReportTest, PictureOfACostOfZeroHasNumbers) {
  result_.ours = {"inceres", "dense_schur", {Record(1.0, 0.0)}, {}};
  const std::string picture = AbPicture(context_, result_);
  EXPECT_EQ(picture.find("nan"), std::string::npos) << picture;
  EXPECT_EQ(picture.find("inf"), std::string::npos) << picture;
}

TEST_F(AbReportTest, TableNamesEverySolverTheRatioAndTheEnvironment) {
  const std::string table = AbTable(context_, result_);
  for (const char* text :
       {"bal:street.txt", "inceres", "sparse_schur", "dropped: hopelessly slow",
        "median 0.500, min 0.250, max 0.750", "relative difference of final costs", "cpu: a <cpu>",
        "2.50e-01 of the scene size"}) {
    EXPECT_NE(table.find(text), std::string::npos) << text << " is missing in\n" << table;
  }
}

TEST(Summarize, OddCountTakesTheMiddleValue) {
  const Spread spread = Summarize({5.0, 1.0, 3.0});
  EXPECT_EQ(spread.median, 3.0);
  EXPECT_EQ(spread.min, 1.0);
  EXPECT_EQ(spread.max, 5.0);
}

TEST(Summarize, EvenCountTakesTheMeanOfTheMiddleValues) {
  EXPECT_EQ(Summarize({4.0, 1.0, 2.0, 100.0}).median, 3.0);
}

TEST(Summarize, OneValueIsItsOwnSpread) {
  const Spread spread = Summarize({7.0});
  EXPECT_EQ(spread.median, 7.0);
  EXPECT_EQ(spread.min, 7.0);
  EXPECT_EQ(spread.max, 7.0);
}

TEST(SummarizeRatios, AreTakenRoundByRound) {
  // The machine is ten times slower in the second round: the ratio of medians would be 2 / 2, the
  // ratios of rounds show 1/2.
  const Spread ratio = SummarizeRatios({1.0, 10.0, 2.0}, {2.0, 20.0, 2.0});
  EXPECT_EQ(ratio.median, 0.5);
  EXPECT_EQ(ratio.min, 0.5);
  EXPECT_EQ(ratio.max, 1.0);
}

TEST(MedianOrNever, NeverIsLaterThanAnyNumber) {
  EXPECT_EQ(MedianOrNever({std::nullopt, 1.0, 3.0}), 3.0);
  EXPECT_EQ(MedianOrNever({2.0, 1.0, 3.0}), 2.0);
  EXPECT_EQ(MedianOrNever({std::nullopt, std::nullopt, 3.0}), std::nullopt);
  EXPECT_EQ(MedianOrNever({std::nullopt, 3.0}), std::nullopt);
  EXPECT_EQ(MedianOrNever({}), std::nullopt);
}

}  // namespace
}  // namespace inceres::tools
