// Callbacks, progress table and the user's memory during a solve in incremental mode: the promises
// of exact mode, kept for iterations that are its own.
#include <chrono>
#include <iostream>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <thread>

#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"
#include "adapters/session_support.h"
#include "inceres/ceres/session.h"

namespace inceres {
namespace {

using testing::MakeBundle;
using testing::TestProblem;
using Options = ceres::Solver::Options;
using Blocks = std::deque<std::vector<double>>;

double CostOf(TestProblem* test) {
  double cost = -1.0;
  test->problem.Evaluate(ceres::Problem::EvaluateOptions(), &cost, nullptr, nullptr, nullptr);
  return cost;
}

// Records what it sees, prints a mark; stops, or throws, at a given iteration.
class Recorder : public ceres::IterationCallback {
 public:
  explicit Recorder(TestProblem* test, int stop_at = -1,
                    ceres::CallbackReturnType stop_with = ceres::SOLVER_CONTINUE)
      : test_(test), stop_at_(stop_at), stop_with_(stop_with) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    iterations.push_back(summary);
    memory.push_back(test_->blocks);
    std::cout << "called back " << summary.iteration << "\n";
    if (summary.iteration == throw_at) {
      throw std::runtime_error("enough");
    }
    return summary.iteration == stop_at_ ? stop_with_ : ceres::SOLVER_CONTINUE;
  }

  std::vector<ceres::IterationSummary> iterations;
  std::vector<Blocks> memory;
  int throw_at = -1;

 private:
  TestProblem* test_;
  int stop_at_;
  ceres::CallbackReturnType stop_with_;
};

// A solve that goes through the batch solver, and one that does not: a session's, on a problem
// solved before and then shaken.
enum class Way { kBatchFirst, kIncremental };
constexpr Way kWays[] = {Way::kBatchFirst, Way::kIncremental};

class Bench {
 public:
  explicit Bench(Way way) : Bench(way, OptionsFor(way)) {}
  Bench(Way way, const SessionOptions& session_options)
      : test(MakeBundle(5, 40, true)), session(session_options) {
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = 200;
    options.function_tolerance = 1e-9;
    if (way == Way::kIncremental) {
      Solve();
      for (std::size_t b = 1; b < test->blocks.size(); b += 3) {
        test->blocks[b][0] += 0.02;
        test->blocks[b][1] -= 0.01;
      }
    }
    start = test->blocks;
  }

  static SessionOptions OptionsFor(Way way) {
    SessionOptions session_options = inceres::testing::AlwaysIncremental();
    session_options.core.batch_share = way == Way::kIncremental ? 1.0 : 0.5;
    return session_options;
  }

  const ceres::Solver::Summary& Solve() {
    SolveOptions strict;
    strict.strict = true;
    session.Solve(options, &test->problem, &summary, strict, &report);
    EXPECT_FALSE(report.used_stock) << report.fallback_reason;
    return summary;
  }

  std::unique_ptr<TestProblem> test;
  Options options;
  CeresSession session;
  SolveReport report;
  ceres::Solver::Summary summary;
  Blocks start;
};

TEST(IncrementalCallbacks, SeeEveryIterationAndUntouchedMemory) {
  for (const Way way : kWays) {
    Bench bench(way);
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

// Powell's function down to the last digit: more iterations than incremental steps are given.
struct Endless {
  explicit Endless(const SessionOptions& session_options = Bench::OptionsFor(Way::kIncremental))
      : session(session_options) {
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = 200;
    options.function_tolerance = 0.0;
    start = test->blocks;
  }

  const ceres::Solver::Summary& Solve() {
    SolveOptions strict;
    strict.strict = true;
    session.Solve(options, &test->problem, &summary, strict, &report);
    return summary;
  }

  std::unique_ptr<TestProblem> test = testing::MakePowell();
  Options options;
  CeresSession session;
  SolveReport report;
  ceres::Solver::Summary summary;
  Blocks start;
};

// Incremental steps that end without convergence are finished by the batch solver: for the user
// that is one solve.
TEST(IncrementalCallbacks, SeeASolveOfTwoPartsAsOne) {
  Endless bench;
  Recorder recorder(bench.test.get());
  bench.options.callbacks = {&recorder};
  const ceres::Solver::Summary& summary = bench.Solve();
  EXPECT_NE(bench.report.exact_reason.find("are the batch solver's"), std::string::npos)
      << bench.report.exact_reason;
  EXPECT_EQ(summary.num_successful_steps + summary.num_unsuccessful_steps,
            static_cast<int>(summary.iterations.size()));
  ASSERT_EQ(recorder.iterations.size(), summary.iterations.size());
  for (std::size_t i = 0; i < summary.iterations.size(); ++i) {
    EXPECT_EQ(summary.iterations[i].iteration, static_cast<int>(i));
    EXPECT_EQ(recorder.iterations[i].iteration, static_cast<int>(i));
    EXPECT_EQ(recorder.iterations[i].cost, summary.iterations[i].cost);
    EXPECT_EQ(recorder.memory[i], bench.start) << i;
  }
  EXPECT_EQ(summary.iterations.front().cost, summary.initial_cost);
  EXPECT_NEAR(CostOf(bench.test.get()), summary.final_cost, 1e-9 * summary.final_cost);
}

// The budget is spent in the part that begins from the start again: nothing follows it.
TEST(IncrementalCallbacks, TheWorkBudgetEndsASolveBetweenItsParts) {
  Endless whole;
  whole.Solve();
  const std::int64_t all =
      whole.report.update.num_evaluated_factors + whole.report.update.num_relinearized_factors;
  for (std::int64_t budget = all / 20; budget < all; budget += all / 20) {
    SCOPED_TRACE(budget);
    SessionOptions session_options = Bench::OptionsFor(Way::kIncremental);
    session_options.core.max_factor_evaluations = budget;
    Endless bench(session_options);
    const ceres::Solver::Summary& summary = bench.Solve();
    EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE) << summary.message;
    EXPECT_NEAR(CostOf(bench.test.get()), summary.final_cost, 1e-9 * summary.final_cost);
  }
}

// A user's word ends the solve in its second part as in its first: with the values he saw, or with
// those of the start.
TEST(IncrementalCallbacks, EndASolveInItsSecondPart) {
  Endless whole;
  const std::string reason = (whole.Solve(), whole.report.exact_reason);
  const int first_part = std::stoi(reason.substr(reason.find("iteration ") + 10));
  for (const bool update : {false, true}) {
    for (const auto end : {ceres::SOLVER_ABORT, ceres::SOLVER_TERMINATE_SUCCESSFULLY}) {
      Endless bench;
      Recorder recorder(bench.test.get(), first_part + 1, end);
      bench.options.update_state_every_iteration = update;
      bench.options.callbacks = {&recorder};
      const ceres::Solver::Summary& summary = bench.Solve();
      EXPECT_EQ(summary.termination_type,
                end == ceres::SOLVER_ABORT ? ceres::USER_FAILURE : ceres::USER_SUCCESS);
      EXPECT_EQ(recorder.iterations.size(), static_cast<std::size_t>(first_part) + 2);
      EXPECT_EQ(bench.test->blocks == bench.start, end == ceres::SOLVER_ABORT);
    }
  }
  Endless bench;
  Recorder recorder(bench.test.get());
  recorder.throw_at = first_part + 1;
  bench.options.callbacks = {&recorder};
  EXPECT_THROW(bench.Solve(), std::runtime_error);
  EXPECT_EQ(bench.test->blocks, bench.start);
}

TEST(IncrementalCallbacks, TheWorkBudgetEndsAllParts) {
  for (const std::int64_t budget : {1, 900, 1500}) {
    SCOPED_TRACE(budget);
    SessionOptions session_options = Bench::OptionsFor(Way::kIncremental);
    session_options.core.max_factor_evaluations = budget;
    Bench bench(Way::kIncremental, session_options);
    EXPECT_EQ(bench.Solve().termination_type, ceres::NO_CONVERGENCE);
    EXPECT_EQ(bench.report.exact_reason, "");
    EXPECT_NEAR(CostOf(bench.test.get()), bench.summary.final_cost,
                1e-9 * bench.summary.final_cost);
  }
}

TEST(IncrementalCallbacks, UpdateStateEveryIterationShowsTheBestState) {
  for (const Way way : kWays) {
    Bench bench(way);
    std::vector<double> costs;
    class Evaluator : public ceres::IterationCallback {
     public:
      Evaluator(TestProblem* test, std::vector<double>* costs) : test_(test), costs_(costs) {}
      ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
        // The cost of what is in memory now, with a copy: Problem::Evaluate is forbidden within a
        // solve.
        const auto copy = MakeBundle(5, 40, true);
        for (std::size_t b = 0; b < copy->blocks.size(); ++b) {
          std::copy(test_->blocks[b].begin(), test_->blocks[b].end(), copy->blocks[b].begin());
        }
        costs_->push_back(CostOf(copy.get()));
        return ceres::SOLVER_CONTINUE;
      }

     private:
      TestProblem* test_;
      std::vector<double>* costs_;
    } evaluator(bench.test.get(), &costs);
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

TEST(IncrementalCallbacks, TheFirstThatDoesNotContinueStops) {
  for (const Way way : kWays) {
    Bench bench(way);
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
    EXPECT_EQ(bench.Solve().termination_type, ceres::CONVERGENCE)
        << "the session goes on from there";
    EXPECT_GT(bench.report.changes.num_kept_factors, 0);
  }
}

TEST(IncrementalCallbacks, AbortRestoresTheStart) {
  for (const Way way : kWays) {
    for (const bool update : {false, true}) {
      for (const int at : {0, 2}) {
        Bench bench(way);
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

TEST(IncrementalCallbacks, AnExceptionOutOfOneRestoresTheStart) {
  for (const Way way : kWays) {
    Bench bench(way);
    Recorder recorder(bench.test.get());
    recorder.throw_at = 2;
    bench.options.update_state_every_iteration = true;
    bench.options.callbacks = {&recorder};
    EXPECT_THROW(bench.Solve(), std::runtime_error);
    EXPECT_NE(recorder.memory.back(), bench.start);
    EXPECT_EQ(bench.test->blocks, bench.start);
  }
}

TEST(IncrementalCallbacks, TheTimeInThemIsReported) {
  struct Sleeper : public ceres::IterationCallback {
    ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      return ceres::SOLVER_CONTINUE;
    }
  };
  for (const Way way : kWays) {
    Bench bench(way);
    Sleeper sleeper;
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

// What a solve prints, row by row.
std::vector<std::string> LinesOf(Bench* bench) {
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

TEST(IncrementalProgress, TableIsInTheFormatOfCeres) {
  for (const Way way : kWays) {
    Bench bench(way);
    Recorder recorder(bench.test.get());
    bench.options.callbacks = {&recorder};
    bench.options.logging_type = ceres::PER_MINIMIZER_ITERATION;
    bench.options.minimizer_progress_to_stdout = true;
    const std::vector<std::string> lines = LinesOf(&bench);
    ASSERT_EQ(lines.size(), 1 + 2 * bench.summary.iterations.size());
    EXPECT_EQ(lines[0],
              "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  "
              "ls_iter  iter_time  total_time");
    const std::string small = " +-?[0-9]\\.[0-9]{2}e[-+][0-9]{2,3}";
    const std::regex row(" *[0-9]+  [0-9]\\.[0-9]{6}e[-+][0-9]{2}" + small + small + small + small +
                         small + " +[0-9]+" + small + small);
    for (std::size_t i = 0; i < bench.summary.iterations.size(); ++i) {
      EXPECT_TRUE(std::regex_match(lines[1 + 2 * i], row)) << lines[1 + 2 * i];
      EXPECT_EQ(std::stoi(lines[1 + 2 * i]), static_cast<int>(i));
      EXPECT_EQ(lines[2 + 2 * i], "called back " + std::to_string(i))
          << "the row comes before the callbacks";
    }
    Bench silent(way);
    silent.options.minimizer_progress_to_stdout = true;
    EXPECT_TRUE(LinesOf(&silent).empty()) << "SILENT rules";
  }
}

}  // namespace
}  // namespace inceres
