// docs/ceres_contract.md, "Preprocessing errors": what fails before anything variable is evaluated,
// through the drop-in too. All of the table next to stock is in adapters/gate_test.cc.
#include <cmath>
#include <cstdio>
#include <limits>

#include "conformance/support.h"

namespace conformance {
namespace {

std::string Pointer(const double* block) {
  char text[32];
  std::snprintf(text, sizeof(text), "%p", static_cast<const void*>(block));
  return text;
}

// A solve that must fail with this message (or a start of it), without a call, a row or a write.
void ExpectRefusal(const Options& options, World* world, const std::string& start,
                   bool whole = false) {
  double* watched = world->Add({1.0});
  int num_calls = 0;
  int num_callbacks = 0;
  auto* cost = new Cost(1, {1}, [&](double const* const*, double* residuals, double**) {
    residuals[0] = 0.0;
    ++num_calls;
    return true;
  });
  world->problem.AddResidualBlock(cost, nullptr, watched);
  Options adjusted = options;
  if (options.linear_solver_ordering != nullptr) {
    adjusted.linear_solver_ordering->AddElementToGroup(watched, 1);
  }
  Callback callback([&](const ceres::IterationSummary&) {
    ++num_callbacks;
    return ceres::SOLVER_CONTINUE;
  });
  adjusted.callbacks.push_back(&callback);
  const auto before = world->blocks;
  const Outcome outcome = Solve(adjusted, &world->problem, Solver::kAnyone);
  EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE);
  EXPECT_TRUE(StartsWith(outcome.summary.message, start))
      << outcome.summary.message << "\nexpected:\n"
      << start;
  EXPECT_TRUE(!whole || outcome.summary.message == start) << outcome.summary.message;
  EXPECT_TRUE(outcome.errors.empty()) << outcome.errors[0];
  EXPECT_EQ(outcome.summary.initial_cost, -1.0);
  EXPECT_EQ(outcome.summary.final_cost, -1.0);
  EXPECT_TRUE(outcome.summary.iterations.empty());
  EXPECT_EQ(num_calls, 0);
  EXPECT_EQ(num_callbacks, 0);
  for (std::size_t b = 0; b < before.size(); ++b) {
    for (std::size_t k = 0; k < before[b].size(); ++k) {
      EXPECT_TRUE(before[b][k] == world->blocks[b][k] || std::isnan(before[b][k]));
    }
  }
}

// Constant and unused blocks are looked at too.
TEST(Preprocessing51, invalid_value) {
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e302}) {
    for (const int kind : {0, 1, 2}) {
      Line line;
      double* block = line.Add({1.0, bad, 3.0});
      line.problem.AddParameterBlock(block, 3);
      if (kind < 2) {
        line.problem.AddResidualBlock(Target({0.0, 0.0, 0.0}), nullptr, block);
      }
      if (kind == 1) {
        line.problem.SetParameterBlockConstant(block);
      }
      ExpectRefusal(
          Small(), &line,
          "ParameterBlock: " + Pointer(block) +
              " with size 3 has at least one invalid value.\nFirst invalid value is at index: 1.\n"
              "Parameter block values: ");
    }
  }
}

TEST(Preprocessing51, ordering_with_a_foreign_pointer) {
  Bundle bundle;
  double foreign = 0.0;
  Options options = Schur();
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (double* point : bundle.points) {
    options.linear_solver_ordering->AddElementToGroup(point, 0);
  }
  for (double* block : {bundle.cameras[0], bundle.cameras[1], &foreign}) {
    options.linear_solver_ordering->AddElementToGroup(block, 1);
  }
  ExpectRefusal(options, &bundle,
                "User specified ordering contains a pointer to a double that is not a parameter "
                "block in the problem. "
                "The invalid double is in group: 1",
                true);
}

// With a Schur type stock Ceres 2.1 crashes here.
TEST(Preprocessing51, inner_iterations_and_evaluation_callback) {
  lambdas::Preparation preparation([](bool, bool) {});
  ceres::Problem::Options problem_options;
  problem_options.evaluation_callback = &preparation;
  World world(problem_options);
  world.problem.AddResidualBlock(Target({1.0}), nullptr, world.Add({0.0}));
  Options options = Small();
  options.use_inner_iterations = true;
  ExpectRefusal(options, &world, "Inner iterations cannot be used with EvaluationCallbacks", true);
}

TEST(Preprocessing51, line_search_with_bounds) {
  Line line;
  line.problem.SetParameterUpperBound(line.x, 0, 5.0);
  Options options = Small();
  options.minimizer_type = ceres::LINE_SEARCH;
  ExpectRefusal(options, &line, "LINE_SEARCH Minimizer does not support bounds.", true);
}

}  // namespace
}  // namespace conformance
