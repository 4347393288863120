#include "inceres/solver/options.h"

#include <functional>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/classic_problems.h"

namespace inceres {
namespace {

constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

TEST(SolverOptions, DefaultsAreValid) {
  EXPECT_TRUE(SolverOptions().Validate().ok());
}

struct BadOption {
  std::string field;
  std::function<void(SolverOptions*)> spoil;
};

class BadOptions : public testing::TestWithParam<BadOption> {};

TEST_P(BadOptions, AreNamedAndLeaveTheStateAlone) {
  SolverOptions options;
  GetParam().spoil(&options);
  const Status status = options.Validate();
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("SolverOptions::" + GetParam().field + " = "), std::string::npos)
      << status.message;

  FactorGraph graph;
  test::MakePowell(&graph);
  const std::vector<double> state = graph.state();
  const Summary summary = Solve(options, &graph);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_EQ(summary.message, status.message);
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(graph.state(), state);
}

INSTANTIATE_TEST_SUITE_P(
    Fields, BadOptions,
    testing::Values(
        BadOption{"num_threads", [](SolverOptions* o) { o->num_threads = 0; }},
        BadOption{"max_num_iterations", [](SolverOptions* o) { o->max_num_iterations = -1; }},
        BadOption{"max_solver_time_in_seconds",
                  [](SolverOptions* o) { o->max_solver_time_in_seconds = -1.0; }},
        BadOption{"max_solver_time_in_seconds",
                  [](SolverOptions* o) { o->max_solver_time_in_seconds = kNotANumber; }},
        BadOption{"function_tolerance", [](SolverOptions* o) { o->function_tolerance = -1e-9; }},
        BadOption{"function_tolerance",
                  [](SolverOptions* o) { o->function_tolerance = kNotANumber; }},
        BadOption{"gradient_tolerance", [](SolverOptions* o) { o->gradient_tolerance = -1e-9; }},
        BadOption{"parameter_tolerance", [](SolverOptions* o) { o->parameter_tolerance = -1e-9; }},
        BadOption{"min_trust_region_radius",
                  [](SolverOptions* o) { o->min_trust_region_radius = 0.0; }},
        BadOption{"max_trust_region_radius",
                  [](SolverOptions* o) { o->max_trust_region_radius = 1e-40; }},
        BadOption{"initial_trust_region_radius",
                  [](SolverOptions* o) { o->initial_trust_region_radius = 1e17; }},
        BadOption{"initial_trust_region_radius",
                  [](SolverOptions* o) { o->initial_trust_region_radius = 0.0; }},
        BadOption{"initial_trust_region_radius",
                  [](SolverOptions* o) { o->initial_trust_region_radius = kNotANumber; }},
        BadOption{"min_relative_decrease",
                  [](SolverOptions* o) { o->min_relative_decrease = -0.1; }},
        BadOption{"min_lm_diagonal", [](SolverOptions* o) { o->min_lm_diagonal = 0.0; }},
        BadOption{"max_lm_diagonal", [](SolverOptions* o) { o->max_lm_diagonal = 1e-7; }},
        BadOption{"max_num_consecutive_invalid_steps",
                  [](SolverOptions* o) { o->max_num_consecutive_invalid_steps = -1; }},
        BadOption{"max_consecutive_nonmonotonic_steps",
                  [](SolverOptions* o) {
                    o->use_nonmonotonic_steps = true;
                    o->max_consecutive_nonmonotonic_steps = 0;
                  }},
        BadOption{"line_search_sufficient_function_decrease",
                  [](SolverOptions* o) { o->line_search_sufficient_function_decrease = 1.0; }},
        BadOption{"max_line_search_step_contraction",
                  [](SolverOptions* o) { o->max_line_search_step_contraction = 0.0; }},
        BadOption{"min_line_search_step_contraction",
                  [](SolverOptions* o) { o->min_line_search_step_contraction = 1e-3; }},
        BadOption{"min_line_search_step_size",
                  [](SolverOptions* o) { o->min_line_search_step_size = kNotANumber; }},
        BadOption{"max_num_line_search_step_size_iterations",
                  [](SolverOptions* o) { o->max_num_line_search_step_size_iterations = -1; }}),
    [](const auto& instance) { return instance.param.field + std::to_string(instance.index); });

TEST(SolverOptions, NonmonotonicWindowCountsOnlyWhenUsed) {
  SolverOptions options;
  options.max_consecutive_nonmonotonic_steps = 0;
  EXPECT_TRUE(options.Validate().ok());
}

TEST(SolverOptions, ZeroTolerancesAndLimitsAreAllowed) {
  SolverOptions options;
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0;
  options.max_num_iterations = 0;
  options.max_solver_time_in_seconds = 0.0;
  options.min_relative_decrease = 0.0;
  options.max_num_consecutive_invalid_steps = 0;
  EXPECT_TRUE(options.Validate().ok());
}

}  // namespace
}  // namespace inceres
