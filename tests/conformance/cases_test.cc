// docs/ceres_contract.md, "Case table". Test names follow its rows; each looks at the user's memory
// afterwards.
#include "conformance/support.h"
#include "support/ceres_manifolds.h"

namespace conformance {
namespace {

TEST(Case52, null_problem_or_summary) {
  Line line;
  Summary summary;
  EXPECT_DEATH(ceres::Solve(Small(), nullptr, &summary), "problem");
  EXPECT_DEATH(ceres::Solve(Small(), &line.problem, nullptr), "summary");
}

TEST(Case52, invalid_options) {
  Line line;
  Options options = Small();
  options.function_tolerance = -1.0;
  const Summary summary = Solve(options, &line.problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(summary.total_time_in_seconds, -1.0);
  EXPECT_EQ(line.x[0], 0.5);
}

void ExpectNothingToSolve(World* world, double cost) {
  int num_callbacks = 0;
  Callback callback([&](const ceres::IterationSummary&) {
    ++num_callbacks;
    return ceres::SOLVER_CONTINUE;
  });
  Options options = Schur();
  options.callbacks.push_back(&callback);
  const auto before = world->blocks;
  const Summary summary = Solve(options, &world->problem).summary;
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(summary.message, "Function tolerance reached. No non-constant parameter blocks found.");
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(summary.initial_cost, cost);
  EXPECT_EQ(summary.final_cost, cost);
  EXPECT_EQ(summary.fixed_cost, cost);
  EXPECT_EQ(summary.num_successful_steps, -1);
  EXPECT_EQ(summary.num_unsuccessful_steps, -1);
  EXPECT_EQ(summary.num_parameter_blocks_reduced, 0);
  EXPECT_EQ(summary.num_residual_evaluations, -1);
  EXPECT_EQ(summary.num_jacobian_evaluations, -1);
  EXPECT_GE(summary.preprocessor_time_in_seconds, 0.0);
  EXPECT_GE(summary.minimizer_time_in_seconds, 0.0);
  EXPECT_GE(summary.total_time_in_seconds, 0.0);
  EXPECT_EQ(summary.linear_solver_type_given, ceres::DENSE_SCHUR);
  EXPECT_EQ(summary.linear_solver_type_used, ceres::SPARSE_NORMAL_CHOLESKY);
  EXPECT_TRUE(summary.linear_solver_ordering_used.empty());
  EXPECT_EQ(num_callbacks, 0);
  EXPECT_EQ(world->blocks, before);
}

TEST(Case52, empty_problem) {
  World world;
  ExpectNothingToSolve(&world, 0.0);
}

TEST(Case52, blocks_but_no_residuals) {
  World world;
  world.problem.AddParameterBlock(world.Add({1.0, 2.0}), 2);
  ExpectNothingToSolve(&world, 0.0);
}

TEST(Case52, all_blocks_constant) {
  Line line;
  line.problem.SetParameterBlockConstant(line.x);
  ExpectNothingToSolve(&line, 45.125);
}

// R² without a degree of freedom; its Plus and PlusJacobian may not be called during the solve.
class Frozen : public manifolds::Manifold {
 public:
  explicit Frozen(int* num_calls) : num_calls_(num_calls) {}
  int AmbientSize() const override { return 2; }
  int TangentSize() const override { return 0; }
  bool Plus(const double* x, const double*, double* sum) const override {
    ++*num_calls_;
    std::copy(x, x + 2, sum);
    return true;
  }
  bool PlusJacobian(const double*, double*) const override { return ++*num_calls_ > 0; }
  bool Minus(const double*, const double*, double*) const override { return true; }
  bool MinusJacobian(const double*, double*) const override { return true; }

 private:
  int* num_calls_;
};

TEST(Case52, all_tangents_of_size_0) {
  int num_calls = 0;
  World world;
  double* x = world.Add({1.0, 2.0});
  world.problem.AddResidualBlock(Target({3.0, 2.0}), nullptr, x);
  manifolds::Set(&world.problem, x, new Frozen(&num_calls));
  num_calls = 0;
  ExpectNothingToSolve(&world, 2.0);
  EXPECT_EQ(num_calls, 0);
}

TEST(Case52, tangent_of_size_0) {
  int num_calls = 0;
  Line line;
  double* y = line.Add({1.0, 2.0});
  auto* cost =
      new Cost(1, {1, 2}, [](double const* const* p, double* residuals, double** jacobians) {
        residuals[0] = p[0][0] - p[1][0];
        if (jacobians != nullptr) {
          EXPECT_EQ(jacobians[1], nullptr);
          jacobians[0][0] = 1.0;
        }
        return true;
      });
  line.problem.AddResidualBlock(cost, nullptr, line.x, y);
  manifolds::Set(&line.problem, y, new Frozen(&num_calls));
  num_calls = 0;
  EXPECT_EQ(Solve(Small(), &line.problem).summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(num_calls, 0);
  EXPECT_NEAR(line.x[0], 5.5, 1e-3);
  EXPECT_EQ(line.blocks[1], (std::vector<double>{1.0, 2.0}));
}

// Dropped, but still looked at.
TEST(Case52, variable_block_with_no_residual) {
  Line line;
  double* unused = line.Add({1.0});
  line.problem.AddParameterBlock(unused, 1);
  EXPECT_EQ(Solve(Small(), &line.problem).summary.num_parameter_blocks_reduced, 1);
  line.problem.SetParameterLowerBound(unused, 0, 3.0);
  line.problem.SetParameterUpperBound(unused, 0, 2.0);
  EXPECT_EQ(Solve(Small(), &line.problem).summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(unused[0], 1.0);
}

TEST(Case52, residual_with_some_constant_blocks) {
  Line line;
  double* c = line.Add({4.0});
  int num_jacobians = 0;
  auto* cost =
      new Cost(1, {1, 1}, [&](double const* const* p, double* residuals, double** jacobians) {
        residuals[0] = p[1][0] - p[0][0];
        EXPECT_EQ(p[0], c) << "constants are read from the user's memory";
        if (jacobians != nullptr) {
          ++num_jacobians;
          EXPECT_EQ(jacobians[0], nullptr);
          jacobians[1][0] = 1.0;
        }
        return true;
      });
  line.problem.AddResidualBlock(cost, nullptr, c, line.x);
  line.problem.SetParameterBlockConstant(c);
  const Summary summary = Solve(Small(), &line.problem).summary;
  EXPECT_EQ(num_jacobians, summary.num_jacobian_evaluations);
  EXPECT_NEAR(line.x[0], 7.0, 1e-3);
  EXPECT_EQ(c[0], 4.0);
}

}  // namespace
}  // namespace conformance
