// Fifty iterations of Levenberg-Marquardt with all tolerances 0: where it ends, and that threads do
// not change a bit.
#include <ostream>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "integration/problems.h"
#include "integration/runs.h"
#include "support/test_data.h"

namespace inceres::test {
namespace {

struct Source {
  std::string name;
  bool bundled;
  std::string path;
};

void PrintTo(const Source& source, std::ostream* stream) {
  *stream << source.name;
}

class WholeRun : public ::testing::TestWithParam<Source> {
 protected:
  void SetUp() override {
    const Source& source = GetParam();
    if (!source.bundled && FindData(source.path).empty()) {
      GTEST_SKIP() << MissingData(source.path);
    }
    if (source.bundled) {
      bal_ = BundledBal(source.path);
    } else {
      const Status read = ReadBal(FindData(source.path), &bal_);
      ASSERT_TRUE(read.ok()) << read.message;
    }
  }

  Solved SolveBy(Who who, int num_threads) const {
    ceres::Solver::Options options = ZeroToleranceOptions(ceres::LEVENBERG_MARQUARDT, 50);
    options.num_threads = num_threads;
    const Factory make = [this](const tools::LossSpec& loss) {
      return MakeBal(bal_, tools::BalCameraModel::kAngleAxis, Gauge::kFree, loss);
    };
    return Solve(who, {ceres::DENSE_SCHUR}, options, make, tools::LossSpec());
  }

  BalProblem bal_;
};

TEST_P(WholeRun, EndsWhereStockEnds) {
  const Solved stock = SolveBy(Who::kStock, 1);
  const Solved ours = SolveBy(Who::kInceres, 1);
  RecordProperty("cost_difference",
                 Printed(RelativeDifference(stock.summary.final_cost, ours.summary.final_cost)));
  EXPECT_LT(stock.summary.final_cost, 0.1 * stock.summary.initial_cost);
  EXPECT_LE(RelativeDifference(stock.summary.initial_cost, ours.summary.initial_cost), 1e-14);
  EXPECT_LE(RelativeDifference(stock.summary.final_cost, ours.summary.final_cost), 1e-8);
}

TEST_P(WholeRun, TwoThreadsGiveTheSameBits) {
  if (std::thread::hardware_concurrency() < 2) {
    GTEST_SKIP() << "needs a second hardware thread";
  }
  const Solved one = SolveBy(Who::kInceres, 1);
  const Solved two = SolveBy(Who::kInceres, 2);
  EXPECT_EQ(two.summary.num_threads_used, 2);
  EXPECT_EQ(one.summary.final_cost, two.summary.final_cost);
  EXPECT_EQ(one.summary.iterations.size(), two.summary.iterations.size());
  EXPECT_TRUE(one.x == two.x);
}

INSTANTIATE_TEST_SUITE_P(Exact, WholeRun,
                         ::testing::Values(Source{"Ladybug49", false,
                                                  "bal/problem-49-7776-pre.txt"},
                                           Source{"BundledStreet", true, "street-16-1200-pre.txt"}),
                         ::testing::PrintToStringParamName());

}  // namespace
}  // namespace inceres::test
