// docs/ceres_contract.md, "Callbacks and state updates": what is in the user's memory when. Test
// names are the fields'.
#include <iostream>
#include <limits>
#include <sstream>

#include "conformance/support.h"

namespace conformance {
namespace {

double RosenbrockCost(const std::vector<double>& x) {
  const double second = 10.0 * (x[1] - x[0] * x[0]);
  return 0.5 * ((1.0 - x[0]) * (1.0 - x[0]) + second * second);
}

TEST(Options24, update_state_every_iteration) {
  Rosenbrock rosenbrock;
  double best = std::numeric_limits<double>::max();
  Callback callback([&](const ceres::IterationSummary& iteration) {
    if (iteration.step_is_successful) {
      best = std::min(best, iteration.cost);
    }
    EXPECT_NEAR(RosenbrockCost(rosenbrock.blocks[0]), best, 1e-12 + 1e-9 * best)
        << "the best so far, at iteration " << iteration.iteration;
    return ceres::SOLVER_CONTINUE;
  });
  Options options = Small();
  options.update_state_every_iteration = true;
  options.use_nonmonotonic_steps = true;
  options.callbacks.push_back(&callback);
  EXPECT_GT(Solve(options, &rosenbrock.problem).summary.iterations.size(), 5u);
}

// Ceres solves by a copy of the options.
TEST(Options24, callbacks_may_change_the_options) {
  Rosenbrock rosenbrock;
  Options options = Small();
  int num_second = 0;
  Callback second([&](const ceres::IterationSummary&) {
    ++num_second;
    return ceres::SOLVER_CONTINUE;
  });
  Callback first([&](const ceres::IterationSummary&) {
    options.callbacks.clear();
    options.callbacks.shrink_to_fit();
    options.update_state_every_iteration = true;
    options.eta = 0.7;
    EXPECT_EQ(rosenbrock.blocks[0], (std::vector<double>{-1.2, 1.0}));
    return ceres::SOLVER_CONTINUE;
  });
  options.callbacks = {&first, &second};
  const Summary summary = Solve(options, &rosenbrock.problem).summary;
  EXPECT_EQ(static_cast<std::size_t>(num_second), summary.iterations.size());
  EXPECT_GT(num_second, 3);
  EXPECT_EQ(summary.iterations[0].eta, Options().eta);
}

// No step can be evaluated, of which the log warns.
TEST(Options24, callbacks_may_silence_solves_to_come) {
  World world;
  double* x = world.Add({0.5});
  world.problem.AddResidualBlock(OnlyAt(0.5), nullptr, x);
  Options options = Small();
  options.max_num_iterations = 2;
  Callback callback([&](const ceres::IterationSummary&) {
    options.logging_type = ceres::SILENT;
    return ceres::SOLVER_CONTINUE;
  });
  options.callbacks.push_back(&callback);
  EXPECT_FALSE(Solve(options, &world.problem).warnings.empty());
  EXPECT_TRUE(Solve(options, &world.problem).warnings.empty());
}

// In each iteration: state update, table, the user's in their order; the first that does not
// continue ends it.
TEST(Options24, callbacks_order) {
  Line line;
  std::vector<double> memory;
  Callback first([&](const ceres::IterationSummary& iteration) {
    memory.push_back(line.x[0]);
    std::cout << "first " << iteration.iteration << "\n";
    return iteration.iteration == 1 ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  });
  Callback second([&](const ceres::IterationSummary& iteration) {
    std::cout << "second " << iteration.iteration << "\n";
    return ceres::SOLVER_CONTINUE;
  });
  Options options = Small();
  options.callbacks = {&first, &second};
  options.minimizer_progress_to_stdout = options.update_state_every_iteration = true;
  const Outcome outcome = Solve(options, &line.problem);
  std::vector<std::string> starts;
  std::istringstream lines(outcome.printed);
  for (std::string text; std::getline(lines, text);) {
    starts.push_back(text.substr(0, 8));
  }
  EXPECT_EQ(starts, (std::vector<std::string>{"iter    ", "   0  4.", "first 0", "second 0",
                                              "   1  4.", "first 1"}));
  ASSERT_EQ(memory.size(), 2u);
  EXPECT_EQ(memory[0], 0.5);
  EXPECT_NEAR(memory[1], 10.0, 1e-3) << "written before the callbacks";
  EXPECT_EQ(outcome.summary.termination_type, ceres::USER_SUCCESS);
}

// Evaluation callback.

struct Prepared {
  bool evaluate_jacobians;
  bool new_evaluation_point;
  double memory;
};

class Preparation : public ceres::EvaluationCallback {
 public:
  void PrepareForEvaluation(bool evaluate_jacobians, bool new_evaluation_point) override {
    calls.push_back({evaluate_jacobians, new_evaluation_point, *watched});
    prepared = *watched;
  }
  const double* watched = nullptr;
  double prepared = 0.0;
  std::vector<Prepared> calls;
};

// r = f(x) where f is taken from what the callback prepared: without its calls the result is wrong.
struct PreparedWorld : World {
  explicit PreparedWorld(Preparation* preparation)
      : World(WithCallback(preparation)), x(Add({-1.2})), y(Add({1.0})) {
    preparation->watched = x;
    problem.AddResidualBlock(Target({1.0}), nullptr, x);
    auto* cost =
        new Cost(1, {1, 1}, [=](double const* const* p, double* residuals, double** jacobians) {
          residuals[0] = 10.0 * (p[1][0] - preparation->prepared * preparation->prepared);
          if (jacobians != nullptr) {
            jacobians[0][0] = -20.0 * preparation->prepared;
            jacobians[1][0] = 10.0;
          }
          return p[0][0] == preparation->prepared;
        });
    problem.AddResidualBlock(cost, nullptr, x, y);
  }
  static ceres::Problem::Options WithCallback(Preparation* preparation) {
    ceres::Problem::Options options;
    options.evaluation_callback = preparation;
    return options;
  }
  double* x;
  double* y;
};

TEST(Options24, evaluation_callback) {
  Preparation preparation;
  PreparedWorld world(&preparation);
  const Summary summary = Solve(Small(), &world.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
  EXPECT_NEAR(world.x[0], 1.0, 1e-5);
  EXPECT_GT(summary.num_unsuccessful_steps, 0);
  // Every evaluation, the one that ended it by tolerance included.
  EXPECT_EQ(static_cast<int>(preparation.calls.size()),
            summary.num_jacobian_evaluations + summary.num_residual_evaluations);
  ASSERT_GT(preparation.calls.size(), 3u);
  EXPECT_TRUE(preparation.calls[0].evaluate_jacobians && preparation.calls[0].new_evaluation_point);
  EXPECT_EQ(preparation.calls[0].memory, -1.2);
  for (std::size_t i = 1; i < preparation.calls.size(); ++i) {
    const Prepared& call = preparation.calls[i];
    EXPECT_NE(call.evaluate_jacobians, call.new_evaluation_point)
        << "only an accepted candidate is evaluated again";
    if (!call.new_evaluation_point) {
      EXPECT_EQ(call.memory, preparation.calls[i - 1].memory);
    }
  }
}

}  // namespace
}  // namespace conformance
