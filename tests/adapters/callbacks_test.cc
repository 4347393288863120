// Callbacks, progress table and the user's memory during a solve.
#include <iostream>
#include <regex>
#include <sstream>

#include <gtest/gtest.h>

#include "adapters/ceres/exact/callback_observer.h"
#include "adapters/compare_with_stock.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::MakeCurveFit;
using testing::MakePowell;
using testing::SolveBoth;
using testing::TestProblem;
using Options = ceres::Solver::Options;

// Records what it sees, prints a mark, stops at a given iteration.
class Recorder : public ceres::IterationCallback {
 public:
  Recorder(const TestProblem* test, int stop_at, ceres::CallbackReturnType stop_with)
      : test_(test), stop_at_(stop_at), stop_with_(stop_with) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    iterations.push_back(summary);
    memory.push_back(test_->blocks);
    std::cout << "called back " << summary.iteration << "\n";
    return summary.iteration == stop_at_ ? stop_with_ : ceres::SOLVER_CONTINUE;
  }

  std::vector<ceres::IterationSummary> iterations;
  std::vector<std::deque<std::vector<double>>> memory;

 private:
  const TestProblem* test_;
  int stop_at_;
  ceres::CallbackReturnType stop_with_;
};

// Solves with both, two recorders each: {stock first, stock second, ours first, ours second}.
struct Recorded {
  std::vector<std::unique_ptr<Recorder>> recorders;
  BothSolved both;
};

Recorded SolveRecorded(Options options, int stop_at, ceres::CallbackReturnType stop_with) {
  Recorded recorded;
  options.linear_solver_type = ceres::DENSE_QR;
  recorded.both = SolveBoth(MakePowell, options, [&](TestProblem* test, Options* adjusted) {
    for (int k = 0; k < 2; ++k) {
      recorded.recorders.push_back(std::make_unique<Recorder>(test, stop_at, stop_with));
      adjusted->callbacks.push_back(recorded.recorders.back().get());
    }
  });
  return recorded;
}

TEST(Callbacks, SeeEveryIterationAndUntouchedMemory) {
  const Recorded r = SolveRecorded(Options(), -1, ceres::SOLVER_CONTINUE);
  const auto start = MakePowell()->blocks;
  for (std::size_t k = 2; k < 4; ++k) {
    ASSERT_EQ(r.recorders[k]->iterations.size(), r.both.ours.iterations.size());
    for (std::size_t i = 0; i < r.both.ours.iterations.size(); ++i) {
      EXPECT_EQ(r.recorders[k]->iterations[i].iteration, static_cast<int>(i));
      EXPECT_EQ(r.recorders[k]->iterations[i].cost, r.both.ours.iterations[i].cost);
      EXPECT_EQ(r.recorders[k]->iterations[i].cumulative_time_in_seconds,
                r.both.ours.iterations[i].cumulative_time_in_seconds);
      EXPECT_EQ(r.recorders[k]->memory[i], start);
    }
  }
  EXPECT_NE(r.both.our_problem->blocks, start);
}

TEST(Callbacks, UpdateStateEveryIterationShowsTheBestState) {
  Options options;
  options.update_state_every_iteration = true;
  const Recorded r = SolveRecorded(options, -1, ceres::SOLVER_CONTINUE);
  const Recorder& stock = *r.recorders[0];
  const Recorder& ours = *r.recorders[2];
  ASSERT_EQ(stock.memory.size(), ours.memory.size());
  EXPECT_EQ(ours.memory[0], MakePowell()->blocks);
  EXPECT_NE(ours.memory[1], ours.memory[0]);
  for (std::size_t i = 0; i < stock.memory.size(); ++i) {
    for (std::size_t b = 0; b < stock.memory[i].size(); ++b) {
      EXPECT_NEAR(stock.memory[i][b][0], ours.memory[i][b][0], 1e-9) << "iteration " << i;
    }
  }
}

TEST(Callbacks, FirstThatDoesNotContinueStops) {
  const Recorded r = SolveRecorded(Options(), 3, ceres::SOLVER_TERMINATE_SUCCESSFULLY);
  ExpectSameSummary(r.both, 1e-9, true);
  EXPECT_EQ(r.both.ours.termination_type, ceres::USER_SUCCESS);
  EXPECT_EQ(r.both.ours.message, r.both.stock.message);
  EXPECT_EQ(r.recorders[2]->iterations.size(), 4u);
  EXPECT_EQ(r.recorders[3]->iterations.size(), 3u)
      << "the second is not called once the first has stopped";
  ExpectSameParameters(r.both, 1e-9);
  EXPECT_NE(r.both.our_problem->blocks, MakePowell()->blocks);
}

TEST(Callbacks, AbortRestoresTheStart) {
  for (const bool update : {false, true}) {
    Options options;
    options.update_state_every_iteration = update;
    const Recorded r = SolveRecorded(options, 3, ceres::SOLVER_ABORT);
    ExpectSameSummary(r.both, 1e-9, true);
    EXPECT_EQ(r.both.ours.termination_type, ceres::USER_FAILURE);
    EXPECT_EQ(r.both.ours.message, r.both.stock.message);
    EXPECT_EQ(r.recorders[2]->memory[3] != MakePowell()->blocks, update);
    EXPECT_EQ(r.both.our_problem->blocks, MakePowell()->blocks);
  }
}

TEST(Callbacks, AbortAtTheStart) {
  const Recorded r = SolveRecorded(Options(), 0, ceres::SOLVER_ABORT);
  ExpectSameSummary(r.both, 1e-9, true);
  EXPECT_EQ(r.both.ours.num_linear_solves, r.both.stock.num_linear_solves);
}

// Progress.

// Standard output of a solve, times replaced.
std::string Output(
    const std::function<void(const Options&, ceres::Problem*, ceres::Solver::Summary*)>& solve,
    Options options) {
  const auto test = MakeCurveFit(0.0);
  options.linear_solver_type = ceres::DENSE_QR;
  Recorder recorder(test.get(), -1, ceres::SOLVER_CONTINUE);
  options.callbacks.push_back(&recorder);
  std::ostringstream captured;
  std::streambuf* previous = std::cout.rdbuf(captured.rdbuf());
  ceres::Solver::Summary summary;
  solve(options, &test->problem, &summary);
  std::cout.rdbuf(previous);
  return std::regex_replace(
      captured.str(),
      std::regex("[0-9]\\.[0-9]{2}e[-+][0-9]{2}    [0-9]\\.[0-9]{2}e[-+][0-9]{2}\n"), "TIMES\n");
}

TEST(Progress, TableIsThatOfCeres) {
  Options options;
  options.minimizer_progress_to_stdout = true;
  options.max_num_iterations = 8;
  const auto stock = [](const Options& o, ceres::Problem* p, ceres::Solver::Summary* s) {
    ceres::Solve(o, p, s);
  };
  const auto ours = [](const Options& o, ceres::Problem* p, ceres::Solver::Summary* s) {
    inceres::Solve(o, p, s);
  };
  const std::string table = Output(ours, options);
  EXPECT_EQ(table, Output(stock, options))
      << "rows come before the callbacks, and steps that cannot be evaluated look the same";
  EXPECT_NE(table.find("iter      cost"), std::string::npos);
  EXPECT_NE(table.find("TIMES\ncalled back 8\n"), std::string::npos) << table;
  options.logging_type = ceres::SILENT;
  EXPECT_EQ(Output(ours, options), Output(stock, options));
  EXPECT_EQ(Output(ours, options).find("cost_change"), std::string::npos);
  options = Options();
  EXPECT_EQ(Output(ours, options).find("cost_change"), std::string::npos) << "off by default";
}

TEST(Progress, RowFormat) {
  ceres::IterationSummary row;
  row.iteration = 0;
  row.cost = 45.125;
  row.gradient_max_norm = 9.5;
  row.trust_region_radius = 1e4;
  row.iteration_time_in_seconds = 5.33e-4;
  row.cumulative_time_in_seconds = 3.46e-3;
  EXPECT_EQ(internal::ProgressText(row),
            "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  ls_iter  "
            "iter_time  total_time\n"
            "   0  4.512500e+01    0.00e+00    9.50e+00   0.00e+00   0.00e+00  1.00e+04        0   "
            " 5.33e-04    3.46e-03");
}

}  // namespace
}  // namespace inceres
