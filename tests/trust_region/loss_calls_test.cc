// How often a batch solve asks a loss: at each candidate, and with Jacobians only where the
// residual is not the one it was asked at before.
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using test::FunctionFamily;

class CountingLoss final : public Loss {
 public:
  void Evaluate(double s, double rho[3]) const override {
    ++num_calls;
    cauchy_.Evaluate(s, rho);
  }
  mutable int num_calls = 0;

 private:
  CauchyLoss cauchy_{0.5};
};

constexpr int kNumFactors = 5;

// x² = i + 1 for each factor i; with Jacobians the residual is off by `error`.
class Squares {
 public:
  explicit Squares(double error) {
    const auto family = graph.AddFamily(std::make_shared<FunctionFamily>(
        1, std::vector<FactorFamily::Slot>{{1, 1}},
        [error](int i, const double* const* x, double* residuals, double** jacobians) {
          residuals[0] = x[0][0] * x[0][0] - (i + 1) + (jacobians != nullptr ? error : 0.0);
          if (jacobians != nullptr && jacobians[0] != nullptr) {
            jacobians[0][0] = 2.0 * x[0][0];
          }
          return true;
        }));
    const double start = 3.0;
    const VariableId x = graph.AddVariable(&start, 1, Role::kFrame);
    for (int i = 0; i < kNumFactors; ++i) {
      graph.AddFactor(family, 0, {x}, loss);
    }
  }
  Summary Minimize() { return Solve(SolverOptions(), &graph); }

  std::shared_ptr<CountingLoss> loss = std::make_shared<CountingLoss>();
  FactorGraph graph;
};

TEST(LossCalls, NoneWithTheJacobiansOfACandidate) {
  Squares squares(0.0);
  const Summary summary = squares.Minimize();
  ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  ASSERT_GT(summary.work.num_jacobian_evaluations, 2);
  EXPECT_EQ(squares.loss->num_calls, kNumFactors * (1 + summary.work.num_residual_evaluations))
      << "the start has no candidate before it";
}

TEST(LossCalls, OneForEachResidualThatIsAnother) {
  Squares squares(1e-9);
  const Summary summary = squares.Minimize();
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_EQ(squares.loss->num_calls, kNumFactors * (summary.work.num_jacobian_evaluations +
                                                    summary.work.num_residual_evaluations));
}

// Another graph of the same structure: what was known of the first one's losses is not believed.
TEST(LossCalls, ASolverThatIsUsedAgainHasTheBitsOfANewOne) {
  Solver solver;
  Squares first(0.0), second(0.0), fresh(0.0);
  solver.Solve(SolverOptions(), &first.graph);
  const Summary reused = solver.Solve(SolverOptions(), &second.graph);
  EXPECT_TRUE(reused.structure_reused);
  EXPECT_EQ(reused.final_cost, fresh.Minimize().final_cost);
  EXPECT_EQ(second.loss->num_calls, fresh.loss->num_calls);
  EXPECT_EQ(second.graph.state(), fresh.graph.state());
}

}  // namespace
}  // namespace inceres
