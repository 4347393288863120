// Callbacks, progress table and the user's memory during a solve: the same promises in exact mode
// and for iterations that are incremental mode's own. That exact mode keeps them as stock Ceres
// does is in bounds_test.cc (MemoryUnderCallbacks).
#include <chrono>
#include <iostream>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <thread>

#include <gtest/gtest.h>

#include "adapters/callbacks_bench.h"

namespace inceres {
namespace {

using testing::CallbacksBench;
using testing::CostOf;
using testing::MakeBundle;
using testing::MakeCurveFit;
using testing::Recorder;
using testing::Way;
using Options = ceres::Solver::Options;

constexpr Way kWays[] = {Way::kExact, Way::kBatchFirst, Way::kIncremental};

TEST(Callbacks, SeeEveryIterationAndUntouchedMemory) {
  for (const Way way : kWays) {
    CallbacksBench bench(way);
    Recorder first(bench.test.get());
    Recorder second(bench.test.get());
    bench.options.callbacks = {&first, &second};
    const ceres::Solver::Summary& summary = bench.Solve();
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
    EXPECT_EQ(bench.report.update.num_batch_iterations > 0, way == Way::kBatchFirst);
    EXPECT_GT(summary.iterations.size(), 2U);
    EXPECT_EQ(summary.num_successful_steps + summary.num_unsuccessful_steps,
              static_cast<int>(summary.iterations.size()));
    for (const Recorder* recorder : {&first, &second}) {
      ASSERT_EQ(recorder->iterations.size(), summary.iterations.size());
      for (std::size_t i = 0; i < summary.iterations.size(); ++i) {
        EXPECT_EQ(recorder->iterations[i].iteration, static_cast<int>(i));
        EXPECT_EQ(recorder->iterations[i].cost, summary.iterations[i].cost);
        EXPECT_EQ(recorder->iterations[i].cumulative_time_in_seconds,
                  summary.iterations[i].cumulative_time_in_seconds);
        EXPECT_EQ(recorder->memory[i], bench.start);
      }
    }
    const ceres::IterationSummary& start = summary.iterations[0];
    EXPECT_TRUE(start.step_is_valid);
    EXPECT_TRUE(start.step_is_successful);
    EXPECT_EQ(start.cost, summary.initial_cost);
    EXPECT_GT(start.gradient_max_norm, 0.0);
    for (std::size_t i = 1; i < summary.iterations.size(); ++i) {
      const ceres::IterationSummary& row = summary.iterations[i];
      EXPECT_GT(row.trust_region_radius, 0.0);
      EXPECT_EQ(row.step_norm > 0.0, row.step_is_valid) << "iteration " << i;
      EXPECT_GT(row.gradient_max_norm, 0.0);
      EXPECT_GT(row.iteration_time_in_seconds, 0.0);
    }
    EXPECT_NE(bench.test->blocks, bench.start);
  }
}

TEST(Callbacks, UpdateStateEveryIterationShowsTheBestState) {
  for (const Way way : kWays) {
    CallbacksBench bench(way);
    std::vector<double> costs;
    // Of what is in memory now, with a copy: Problem::Evaluate is forbidden within a solve.
    lambdas::Callback evaluator([&](const ceres::IterationSummary&) {
      const auto copy = MakeBundle(5, 40, true);
      for (std::size_t b = 0; b < copy->blocks.size(); ++b) {
        std::copy_n(bench.test->blocks[b].begin(), copy->blocks[b].size(), copy->blocks[b].begin());
      }
      costs.push_back(CostOf(copy.get()));
      return ceres::SOLVER_CONTINUE;
    });
    bench.options.update_state_every_iteration = true;
    bench.options.callbacks = {&evaluator};
    const ceres::Solver::Summary& summary = bench.Solve();
    ASSERT_EQ(costs.size(), summary.iterations.size());
    double best = summary.initial_cost;
    for (std::size_t i = 0; i < costs.size(); ++i) {
      if (summary.iterations[i].step_is_successful) {
        best = summary.iterations[i].cost;
      }
      EXPECT_NEAR(costs[i], best, 1e-9 * best) << "iteration " << i;
    }
    EXPECT_NEAR(CostOf(bench.test.get()), summary.final_cost, 1e-9 * summary.final_cost);
    EXPECT_LT(best, 0.999 * summary.initial_cost);
  }
}

TEST(Callbacks, TheFirstThatDoesNotContinueStops) {
  for (const Way way : kWays) {
    CallbacksBench bench(way);
    Recorder first(bench.test.get(), 2, ceres::SOLVER_TERMINATE_SUCCESSFULLY);
    Recorder second(bench.test.get());
    bench.options.callbacks = {&first, &second};
    const ceres::Solver::Summary& summary = bench.Solve();
    EXPECT_EQ(summary.termination_type, ceres::USER_SUCCESS);
    EXPECT_EQ(summary.message, "User callback returned SOLVER_TERMINATE_SUCCESSFULLY.");
    EXPECT_EQ(first.iterations.size(), 3U);
    EXPECT_EQ(second.iterations.size(), 2U);
    EXPECT_EQ(summary.iterations.size(), 3U);
    EXPECT_NE(bench.test->blocks, bench.start);
    EXPECT_NEAR(CostOf(bench.test.get()), summary.iterations.back().cost,
                1e-9 * summary.final_cost);
    bench.options.callbacks.clear();
    EXPECT_EQ(bench.Solve().termination_type, ceres::CONVERGENCE);
    EXPECT_EQ(bench.report.changes.num_kept_factors > 0, way != Way::kExact)
        << "a session goes on from there";
  }
}

TEST(Callbacks, AbortRestoresTheStart) {
  for (const Way way : kWays) {
    for (const bool update : {false, true}) {
      for (const int at : {0, 2}) {
        CallbacksBench bench(way);
        Recorder recorder(bench.test.get(), at, ceres::SOLVER_ABORT);
        bench.options.update_state_every_iteration = update;
        bench.options.callbacks = {&recorder};
        const ceres::Solver::Summary& summary = bench.Solve();
        EXPECT_EQ(summary.termination_type, ceres::USER_FAILURE);
        EXPECT_EQ(summary.message, "User callback returned SOLVER_ABORT.");
        EXPECT_EQ(static_cast<int>(summary.iterations.size()), at + 1);
        EXPECT_EQ(recorder.memory.back() != bench.start, update && at > 0);
        EXPECT_EQ(bench.test->blocks, bench.start);
        bench.options.callbacks.clear();
        EXPECT_EQ(bench.Solve().termination_type, ceres::CONVERGENCE)
            << "another solve finds the minimum";
        EXPECT_LT(summary.final_cost, 0.999 * summary.initial_cost);
      }
    }
  }
}

// In exact mode with update_state_every_iteration memory follows the solve.
TEST(Callbacks, AnExceptionOutOfOneRestoresTheStart) {
  for (const Way way : kWays) {
    for (const bool update : {false, true}) {
      CallbacksBench bench(way);
      Recorder recorder(bench.test.get());
      lambdas::Callback thrower([](const ceres::IterationSummary& row) {
        return row.iteration == 2 ? throw std::runtime_error("enough") : ceres::SOLVER_CONTINUE;
      });
      bench.options.update_state_every_iteration = update;
      bench.options.callbacks = {&recorder, &thrower};
      EXPECT_THROW(bench.Solve(), std::runtime_error);
      EXPECT_EQ(recorder.memory.back() != bench.start, update);
      EXPECT_EQ(bench.test->blocks, way == Way::kExact ? recorder.memory.back() : bench.start);
    }
  }
}

TEST(Callbacks, TheTimeInThemIsReported) {
  lambdas::Callback sleeper([](const ceres::IterationSummary&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    return ceres::SOLVER_CONTINUE;
  });
  for (const Way way : kWays) {
    CallbacksBench bench(way);
    bench.options.callbacks = {&sleeper, &sleeper};
    bench.Solve();
    EXPECT_GE(bench.report.callback_seconds,
              0.004 * static_cast<double>(bench.summary.iterations.size()));
    EXPECT_LE(bench.report.callback_seconds, bench.summary.minimizer_time_in_seconds);
    bench.options.callbacks.clear();
    bench.Solve();
    EXPECT_EQ(bench.report.callback_seconds, 0.0);
  }
}

// Progress.

ceres::CallbackReturnType PrintMark(const ceres::IterationSummary& row) {
  std::cout << "called back " << row.iteration << "\n";
  return ceres::SOLVER_CONTINUE;
}

// Standard output of a solve, times replaced.
std::string Output(
    const std::function<void(const Options&, ceres::Problem*, ceres::Solver::Summary*)>& solve,
    Options options) {
  const auto test = MakeCurveFit(0.0);
  options.linear_solver_type = ceres::DENSE_QR;
  lambdas::Callback marker(PrintMark);
  options.callbacks.push_back(&marker);
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

// What a solve prints, row by row.
std::vector<std::string> LinesOf(CallbacksBench* bench) {
  std::ostringstream captured;
  std::streambuf* previous = std::cout.rdbuf(captured.rdbuf());
  bench->Solve();
  std::cout.rdbuf(previous);
  std::vector<std::string> lines;
  std::istringstream text(captured.str());
  for (std::string line; std::getline(text, line);) {
    lines.push_back(line);
  }
  return lines;
}

TEST(Progress, TableIsInTheFormatOfCeres) {
  for (const Way way : kWays) {
    CallbacksBench bench(way);
    lambdas::Callback marker(PrintMark);
    bench.options.callbacks = {&marker};
    bench.options.logging_type = ceres::PER_MINIMIZER_ITERATION;
    bench.options.minimizer_progress_to_stdout = true;
    const std::vector<std::string> lines = LinesOf(&bench);
    ASSERT_EQ(lines.size(), 1 + 2 * bench.summary.iterations.size());
    EXPECT_EQ(lines[0],
              "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  "
              "ls_iter  iter_time  total_time");
    for (std::size_t i = 0; i < bench.summary.iterations.size(); ++i) {
      EXPECT_EQ(std::stoi(lines[1 + 2 * i]), static_cast<int>(i));
      EXPECT_EQ(lines[2 + 2 * i], "called back " + std::to_string(i))
          << "the row comes before the callbacks";
      EXPECT_EQ(lines[1 + 2 * i].size(), lines[1].size());
    }
    CallbacksBench silent(way);
    silent.options.minimizer_progress_to_stdout = true;
    EXPECT_TRUE(LinesOf(&silent).empty()) << "SILENT rules";
  }
}

}  // namespace
}  // namespace inceres
