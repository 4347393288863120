// Summary's reports, the table of progress and the callback of a batch solve.
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "inceres/version.h"
#include "support/classic_problems.h"
#include "support/random_graph.h"

namespace inceres {
namespace {

bool Has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(SummaryReport, BriefIsOneLineOfCostsAndTermination) {
  FactorGraph graph;
  test::MakeCurveFit(&graph);
  const Summary summary = Solve(SolverOptions(), &graph);
  const std::string brief = summary.BriefReport();
  EXPECT_FALSE(Has(brief, "\n"));
  EXPECT_TRUE(Has(brief, "Iterations: " + std::to_string(summary.iterations.size() - 1) + ","))
      << brief;
  EXPECT_TRUE(Has(brief, "Termination: CONVERGENCE")) << brief;
  std::ostringstream stream;
  stream << summary;
  EXPECT_EQ(stream.str(), brief);
}

TEST(SummaryReport, FullTellsSizesSolverCostsSecondsAndTermination) {
  test::BundleOptions bundle;
  bundle.num_frames = 6;
  bundle.num_landmarks = 30;
  bundle.constants = true;
  const auto problem = test::MakeBundle(bundle);
  SolverOptions options;
  options.num_threads = 2;
  options.strategy = TrustRegionStrategyKind::kDogleg;
  const Summary summary = Solve(options, &problem->graph());
  const std::string full = summary.FullReport();
  for (const char* part : {"Solver Summary (inceres " INCERES_VERSION_STRING ")",
                           "Problem",
                           "Moving",
                           "Variables",
                           "Dimensions",
                           "Factors",
                           "Residuals",
                           "Trust region strategy",
                           "dogleg",
                           "Threads",
                           "Eliminated landmarks",
                           "Cost:\n",
                           "Initial",
                           "Final",
                           "Change",
                           "Successful steps",
                           "Time (in seconds):\n",
                           "Jacobian evaluation",
                           "Total",
                           "Termination:",
                           "CONVERGENCE ("}) {
    EXPECT_TRUE(Has(full, part)) << part << " is not in\n" << full;
  }
  EXPECT_TRUE(Has(full, "(" + summary.message + ")\n"));
  EXPECT_TRUE(Has(full, summary.reduced_solver));
}

TEST(SummaryReport, SizesAreThoseOfTheGraphAndOfWhatMoves) {
  test::BundleOptions bundle;
  bundle.constants = true;
  bundle.manifolds = true;
  const auto problem = test::MakeBundle(bundle);
  FactorGraph& graph = problem->graph();
  const ProblemSizes sizes = Solve(SolverOptions(), &graph).sizes;
  EXPECT_EQ(sizes.num_variables, graph.num_variables());
  EXPECT_EQ(sizes.num_factors, graph.num_factors());
  int num_moving = 0, num_values = 0, num_dimensions = 0;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    num_moving += graph.IsConstant(id) ? 0 : 1;
    num_values += graph.IsConstant(id) ? 0 : graph.AmbientSize(id);
    num_dimensions += graph.IsConstant(id) ? 0 : graph.TangentSize(id);
  }
  EXPECT_EQ(sizes.num_moving_variables, num_moving);
  EXPECT_EQ(sizes.num_moving_values, num_values);
  EXPECT_EQ(sizes.num_dimensions, num_dimensions);
  EXPECT_LT(num_moving, sizes.num_variables);
  EXPECT_LT(num_dimensions, num_values);
  std::int64_t num_residuals = 0;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    num_residuals += graph.NumFactors(id) * graph.family(id).residual_size();
  }
  EXPECT_EQ(sizes.num_residuals, num_residuals);
}

TEST(SummaryReport, OfAFailureNamesTheCulpritAndNoFinalCost) {
  FactorGraph graph;
  test::MakeCurveFit(&graph);
  graph.mutable_state()[0] = 1e4;  // exp overflows
  const Summary summary = Solve(SolverOptions(), &graph);
  ASSERT_EQ(summary.termination, Termination::kFailure);
  const std::string full = summary.FullReport();
  EXPECT_FALSE(summary.detail.empty());
  EXPECT_TRUE(Has(full, "Detail: " + summary.detail)) << full;
  EXPECT_FALSE(Has(full, "Final ")) << full;
  EXPECT_TRUE(Has(Summary().FullReport(), "inceres::Solve was not called.")) << "never solved";
  EXPECT_TRUE(Has(Summary().BriefReport(), "Iterations: 0,"));
}

class Progress : public testing::Test {
 protected:
  Progress() {
    test::MakeRosenbrock(&graph_);
    start_ = graph_.state();
    options_.progress = [this](const std::string& line) { lines_.push_back(line); };
  }

  FactorGraph graph_;
  std::vector<double> start_;
  SolverOptions options_;
  std::vector<std::string> lines_;
};

TEST_F(Progress, IsATableWithARowAnIteration) {
  const Summary summary = Solve(options_, &graph_);
  ASSERT_EQ(lines_.size(), summary.iterations.size() + 1);
  EXPECT_EQ(lines_[0], ProgressHeading());
  for (std::size_t k = 0; k < summary.iterations.size(); ++k) {
    EXPECT_EQ(lines_[k + 1], ProgressRow(summary.iterations[k]));
  }
}

TEST_F(Progress, ColumnsAreThoseOfCeres) {
  EXPECT_EQ(ProgressHeading(),
            "iter      cost      cost_change  |gradient|   |step|    tr_ratio  tr_radius  ls_iter  "
            "iter_time  total_time");
  IterationSummary row;
  row.iteration = 3;
  row.cost = 12.5;
  row.cost_change = -0.25;
  row.gradient_max_norm = 9.5;
  row.trust_region_radius = 1e4;
  row.linear_solver_iterations = 1;
  row.iteration_time_in_seconds = 5.33e-4;
  row.cumulative_time_in_seconds = 3.46e-3;
  EXPECT_EQ(ProgressRow(row),
            "   3  1.250000e+01   -2.50e-01    9.50e+00   0.00e+00   0.00e+00  1.00e+04        1   "
            " 5.33e-04    3.46e-03");
}

TEST_F(Progress, GoesToAStreamLineByLine) {
  std::ostringstream stream;
  options_.progress = LogTo(stream);
  options_.max_num_iterations = 0;
  Solve(options_, &graph_);
  EXPECT_EQ(stream.str().find(ProgressHeading() + "\n   0  "), 0u) << stream.str();
  EXPECT_EQ(stream.str().back(), '\n');
}

TEST_F(Progress, ChangesNoBit) {
  const Summary with = Solve(options_, &graph_);
  const std::vector<double> found = graph_.state();
  graph_.mutable_state() = start_;
  const Summary without = Solve(SolverOptions(), &graph_);
  EXPECT_EQ(graph_.state(), found);
  EXPECT_EQ(with.final_cost, without.final_cost);
}

TEST_F(Progress, CallbackEndsWithTheBestState) {
  std::vector<double> best;
  options_.callback = [&](const IterationSummary& iteration, const double* best_state) {
    best.assign(best_state, best_state + start_.size());
    EXPECT_EQ(graph_.state(), start_) << "the graph waits for the end";
    return iteration.iteration == 4 ? ObserverAction::kTerminateSuccessfully
                                    : ObserverAction::kContinue;
  };
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kUserSuccess);
  EXPECT_EQ(summary.iterations.size(), 5u);
  EXPECT_EQ(lines_.size(), 6u) << "the row comes before the callback";
  EXPECT_EQ(graph_.state(), best);
  EXPECT_NE(graph_.state(), start_);
}

TEST_F(Progress, CallbackAbortsWithTheStart) {
  options_.callback = [](const IterationSummary& iteration, const double*) {
    return iteration.iteration == 2 ? ObserverAction::kAbort : ObserverAction::kContinue;
  };
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kUserFailure);
  EXPECT_EQ(graph_.state(), start_);
}

// Row, observer, callback; who ends the solve is the last to be asked.
TEST_F(Progress, ObserverIsAskedBeforeTheCallback) {
  class Stop final : public SolveObserver {
   public:
    explicit Stop(std::string* log) : log_(*log) {}
    ObserverAction EndOfIteration(const IterationSummary& iteration, const double*) override {
      log_ += 'o';
      return iteration.iteration == 1 ? ObserverAction::kTerminateSuccessfully
                                      : ObserverAction::kContinue;
    }

   private:
    std::string& log_;
  };
  std::string log;
  Stop stop(&log);
  options_.observer = &stop;
  options_.progress = [&](const std::string&) { log += 'p'; };
  options_.callback = [&](const IterationSummary&, const double*) {
    log += 'c';
    return ObserverAction::kContinue;
  };
  EXPECT_EQ(Solve(options_, &graph_).termination, Termination::kUserSuccess);
  EXPECT_EQ(log, "ppocpo");
}

TEST_F(Progress, WhatACallbackThrowsPassesThroughAndTheGraphIsAsBefore) {
  Solver solver;
  ASSERT_TRUE(solver.Solve(SolverOptions(), &graph_).IsSolutionUsable());
  const std::vector<double> found = graph_.state();
  graph_.mutable_state() = start_;
  options_.callback = [](const IterationSummary& iteration, const double*) {
    if (iteration.iteration == 3) {
      throw std::runtime_error("enough");
    }
    return ObserverAction::kContinue;
  };
  EXPECT_THROW(solver.Solve(options_, &graph_), std::runtime_error);
  EXPECT_EQ(graph_.state(), start_);
  const Summary again = solver.Solve(SolverOptions(), &graph_);
  EXPECT_FALSE(again.structure_reused);
  EXPECT_EQ(graph_.state(), found);
}

}  // namespace
}  // namespace inceres
