// Conjugate gradients with the factor of an earlier matrix: as exact as promised, and the factor
// renewed only when it must be.
#include "linear/lagged_pcg.h"

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/counting_solver.h"
#include "linear/random_system.h"

namespace inceres::internal {
namespace {

using Fill = RandomSystem::Fill;

class LaggedPcgTest : public testing::Test {
 protected:
  // Solves, and returns the share of the solution's energy norm that is wrong.
  double EnergyErrorOf(RandomSystem& system) {
    EXPECT_TRUE(solver_.Factorize(system.Matrix(), {}).ok());
    const Eigen::MatrixXd A = system.Dense();
    const std::vector<double> b = system.random.Vector(static_cast<std::size_t>(A.rows()));
    Eigen::VectorXd x = Eigen::VectorXd::Constant(A.rows(), 77.0);
    EXPECT_TRUE(solver_.Solve(b.data(), {}, {}, x.data()).ok());
    const Eigen::VectorXd exact =
        A.llt().solve(Eigen::Map<const Eigen::VectorXd>(b.data(), A.rows()));
    return std::sqrt((x - exact).dot(A * (x - exact)) / exact.dot(A * exact));
  }

  // Damps each unknown by up to that share of its diagonal entry.
  static void Disturb(double share, RandomSystem* system) {
    const Eigen::MatrixXd A = system->Dense();
    for (std::size_t k = 0; k < system->diagonal.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      system->diagonal[k] += share * 0.5 * (1.0 + system->random.Unit()) * A(i, i);
    }
  }

  test::CountingSolver::Record factor_;
  LaggedPcg solver_{std::make_unique<test::CountingSolver>(&factor_)};
};

TEST_F(LaggedPcgTest, SolvesInEveryPattern) {
  for (const auto& [sizes, fill] :
       {std::pair{std::vector<int>{6, 1, 15, 9, 3, 7, 33, 2}, Fill::kDense},
        std::pair{std::vector<int>(60, 9), Fill::kBand},
        std::pair{std::vector<int>{5}, Fill::kDiagonal}}) {
    RandomSystem system(sizes, fill);
    system.values[static_cast<std::size_t>(system.pattern.value_begin[0])] += 1.0;
    factor_.num_factorizations = 0;
    ASSERT_TRUE(solver_.Analyze(system.Matrix()).ok());
    EXPECT_LT(EnergyErrorOf(system), 1e-10) << "the factor is of this very matrix";
    EXPECT_EQ(factor_.num_factorizations, 1);
    EXPECT_EQ(solver_.work().iterations, 1);
  }
}

TEST_F(LaggedPcgTest, AMatrixThatChangedALittleIsSolvedWithTheFactorOfTheOld) {
  RandomSystem system(std::vector<int>(60, 9), Fill::kBand);
  ASSERT_TRUE(solver_.Analyze(system.Matrix()).ok());
  EnergyErrorOf(system);
  for (int k = 0; k < 5; ++k) {
    Disturb(0.05, &system);
    EXPECT_LT(EnergyErrorOf(system), 2.0 * LaggedPcg::kTolerance);
    EXPECT_GT(solver_.work().iterations, 1);
  }
  EXPECT_EQ(factor_.num_factorizations, 1);
}

TEST_F(LaggedPcgTest, AMatrixThatChangedMuchIsFactoredAnew) {
  RandomSystem system(std::vector<int>(60, 9), Fill::kBand);
  ASSERT_TRUE(solver_.Analyze(system.Matrix()).ok());
  EnergyErrorOf(system);
  system.FillValues();  // quite another one
  for (std::size_t k = 0; k < system.diagonal.size(); ++k) {
    system.diagonal[k] *= k % 2 == 0 ? 1e6 : 1.0;
  }
  EXPECT_LT(EnergyErrorOf(system), 2.0 * LaggedPcg::kTolerance);
  EnergyErrorOf(system);
  EXPECT_EQ(factor_.num_factorizations, 2);
}

TEST_F(LaggedPcgTest, ANewPatternForgets) {
  RandomSystem first({6, 6, 6}, Fill::kDense), second({9, 1}, Fill::kDense);
  ASSERT_TRUE(solver_.Analyze(first.Matrix()).ok());
  EnergyErrorOf(first);
  ASSERT_TRUE(solver_.Analyze(second.Matrix()).ok());
  EXPECT_LT(EnergyErrorOf(second), 1e-10);
  const std::vector<double> zero(10, 0.0);
  std::vector<double> x(10, 7.0);
  ASSERT_TRUE(solver_.Solve(zero.data(), {}, {}, x.data()).ok());
  EXPECT_EQ(x, zero);
}

TEST_F(LaggedPcgTest, AMatrixThatIsNotPositiveDefiniteIsSingular) {
  RandomSystem system({6, 6, 6}, Fill::kDense);
  RandomSystem bad = system;
  for (const std::size_t k : {0u, 2u, 5u}) {  // the diagonal blocks
    bad.values[static_cast<std::size_t>(bad.pattern.value_begin[k])] -= 1e3;
  }
  std::vector<double> b(18, 1.0), x(18);
  ASSERT_TRUE(solver_.Analyze(bad.Matrix()).ok());
  EXPECT_EQ(solver_.Factorize(bad.Matrix(), {}).code, StatusCode::kSingular);
  EXPECT_EQ(solver_.Solve(b.data(), {}, {}, x.data()).code, StatusCode::kSingular);
  // Behind a good one it is found out by the iteration.
  ASSERT_TRUE(solver_.Factorize(system.Matrix(), {}).ok());
  ASSERT_TRUE(solver_.Solve(b.data(), {}, {}, x.data()).ok());
  ASSERT_TRUE(solver_.Factorize(bad.Matrix(), {}).ok());
  EXPECT_EQ(solver_.Solve(b.data(), {}, {}, x.data()).code, StatusCode::kSingular);
}

}  // namespace
}  // namespace inceres::internal
