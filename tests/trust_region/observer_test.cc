// The hooks: which calls in which order, and what an observer can stop.
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/classic_problems.h"
#include "support/dense_oracle.h"
#include "trust_region/loop_options.h"

namespace inceres {
namespace {

// Writes every call down; asks for `action` at the end of iteration `at`.
class Recorder final : public SolveObserver, public internal::StepJudge {
 public:
  explicit Recorder(const FactorGraph& graph) : graph_(graph) {}

  void BeforeEvaluation(const double* state, bool jacobians, bool new_point) override {
    log += jacobians ? (new_point ? "J" : "j") : "r";
    EXPECT_TRUE(new_point || jacobians);
    evaluated.emplace_back(state, state + graph_.state().size());
  }
  bool IsWorthTrying(const IterationSummary& summary, const internal::StepOrigin& origin) override {
    EXPECT_GT(summary.model_cost_change, 0.0);
    if (summary.iteration == not_worth) {
      cost_there = origin.cost;
    }
    return summary.iteration != not_worth;
  }
  bool IsLast(const IterationSummary& summary) override { return summary.iteration == last; }
  ObserverAction EndOfIteration(const IterationSummary& summary,
                                const double* best_state) override {
    log += "|";
    iterations.push_back(summary);
    best.emplace_back(best_state, best_state + graph_.state().size());
    return summary.iteration == at ? action : ObserverAction::kContinue;
  }

  std::string log;
  std::vector<IterationSummary> iterations;
  std::vector<std::vector<double>> evaluated;
  std::vector<std::vector<double>> best;
  int at = -1;
  int last = -1;
  int not_worth = -1;
  double cost_there = -1.0;
  ObserverAction action = ObserverAction::kContinue;

 private:
  const FactorGraph& graph_;
};

class Observer : public testing::Test {
 protected:
  Observer() : recorder_((test::MakeRosenbrock(&graph_), graph_)), start_(graph_.state()) {
    options_.observer = &recorder_;
    options_.function_tolerance = options_.parameter_tolerance = 0.0;
    options_.gradient_tolerance = 1e-6;
  }

  // Where the recorder is the judge too.
  Summary SolveJudged() {
    internal::LoopOptions loop;
    loop.judge = &recorder_;
    Solver solver;
    Summary summary;
    internal::SolveWith(options_, loop, &graph_, &solver, &summary);
    return summary;
  }

  FactorGraph graph_;
  Recorder recorder_;
  std::vector<double> start_;
  SolverOptions options_;
};

TEST_F(Observer, EndsWithAStepWithoutJacobiansThere) {
  const Summary whole = Solve(options_, &graph_);
  ASSERT_GT(whole.num_successful_steps, 4);
  for (recorder_.last = 1; !whole.iterations[recorder_.last].step_is_successful; ++recorder_.last) {
  }
  recorder_.log.clear();
  graph_.mutable_state() = start_;
  const Summary summary = SolveJudged();
  EXPECT_EQ(summary.termination, Termination::kUserSuccess) << summary.message;
  EXPECT_EQ(recorder_.log.substr(recorder_.log.size() - 2), "r|");
  ASSERT_EQ(static_cast<int>(summary.iterations.size()), recorder_.last + 1);
  EXPECT_EQ(summary.final_cost, whole.iterations[recorder_.last].cost);
  EXPECT_EQ(summary.iterations.back().gradient_norm,
            summary.iterations[recorder_.last - 1].gradient_norm);
  EXPECT_EQ(graph_.state(), recorder_.best.back());
  EXPECT_NE(graph_.state(), start_);
}

TEST_F(Observer, EndsBeforeAStepThatIsNotWorthTrying) {
  const Summary whole = Solve(options_, &graph_);
  graph_.mutable_state() = start_;
  recorder_.log.clear();
  recorder_.not_worth = static_cast<int>(whole.iterations.size()) - 2;
  const Summary summary = SolveJudged();
  EXPECT_EQ(summary.termination, Termination::kUserSuccess) << summary.message;
  EXPECT_EQ(static_cast<int>(summary.iterations.size()), recorder_.not_worth);
  EXPECT_EQ(recorder_.log.back(), '|');
  EXPECT_EQ(graph_.state(), recorder_.best.back());
  EXPECT_EQ(summary.final_cost, recorder_.cost_there);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
}

// "J|" for the start, then "rj|" for an accepted and "r|" for a rejected step.
TEST_F(Observer, SeesEveryEvaluationAndEveryIteration) {
  const Summary summary = Solve(options_, &graph_);
  ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  std::string expected = "J|";
  for (std::size_t k = 1; k < summary.iterations.size(); ++k) {
    expected += summary.iterations[k].step_is_successful ? "rj|" : "r|";
  }
  EXPECT_EQ(recorder_.log, expected);
  EXPECT_GT(summary.num_unsuccessful_steps, 0)
      << "no rejected step: half of the order is not tested";
  EXPECT_EQ(recorder_.iterations.size(), summary.iterations.size());
  for (std::size_t k = 0; k < summary.iterations.size(); ++k) {
    EXPECT_EQ(recorder_.iterations[k].cost, summary.iterations[k].cost);
    EXPECT_EQ(recorder_.iterations[k].iteration, static_cast<int>(k));
  }
  EXPECT_EQ(recorder_.evaluated.front(), start_);
  EXPECT_EQ(recorder_.best.front(), start_);
  EXPECT_EQ(recorder_.best.back(), graph_.state());
}

TEST_F(Observer, SeesTheCandidateAndAgainOnceItIsAccepted) {
  Solve(options_, &graph_);
  std::size_t at = 0;
  for (std::size_t k = 0; k < recorder_.log.size(); ++k) {
    if (recorder_.log[k] == 'j') {
      EXPECT_EQ(recorder_.evaluated[at], recorder_.evaluated[at - 1]);
    }
    at += recorder_.log[k] == '|' ? 0 : 1;
  }
}

// A convergence by function tolerance discards the candidate: its evaluation is the last call.
TEST_F(Observer, DoesNotSeeTheIterationThatConverges) {
  options_.function_tolerance = 0.9;
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kConvergence);
  EXPECT_EQ(recorder_.log.back(), 'r');
}

TEST_F(Observer, AbortLeavesTheStateUntouched) {
  recorder_.at = 3;
  recorder_.action = ObserverAction::kAbort;
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kUserFailure);
  EXPECT_EQ(summary.message, "User callback returned SOLVER_ABORT.");
  EXPECT_FALSE(summary.IsSolutionUsable());
  EXPECT_EQ(summary.iterations.size(), 4u) << "the iteration is included";
  EXPECT_EQ(graph_.state(), start_);
}

TEST_F(Observer, TerminateKeepsTheBestState) {
  recorder_.at = 5;
  recorder_.action = ObserverAction::kTerminateSuccessfully;
  const Summary summary = Solve(options_, &graph_);
  EXPECT_EQ(summary.termination, Termination::kUserSuccess);
  EXPECT_EQ(summary.message, "User callback returned SOLVER_TERMINATE_SUCCESSFULLY.");
  EXPECT_TRUE(summary.IsSolutionUsable());
  EXPECT_EQ(summary.iterations.size(), 6u);
  EXPECT_EQ(graph_.state(), recorder_.best.back());
  EXPECT_NEAR(test::CostAt(graph_, graph_.state()), summary.final_cost, 1e-12);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
}

// The observer speaks before limits and tolerances do.
TEST_F(Observer, IsAskedBeforeTheIterationLimit) {
  recorder_.at = 0;
  recorder_.action = ObserverAction::kTerminateSuccessfully;
  options_.max_num_iterations = 0;
  options_.max_solver_time_in_seconds = 0.0;
  EXPECT_EQ(Solve(options_, &graph_).termination, Termination::kUserSuccess);
}

TEST_F(Observer, IsNotCalledWhenNothingMoves) {
  graph_.SetConstant(0, true);
  EXPECT_EQ(Solve(options_, &graph_).termination, Termination::kConvergence);
  EXPECT_EQ(recorder_.log, "");
}

}  // namespace
}  // namespace inceres
