// Elimination by rows of very different sizes: what weak ones say keeps its digits.
#include "marginal/row_elimination.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

using Exact = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

// A stiff row has x₁ + 0.6 y + 0.7e-8 x₀, and of x₀ no more than the weak rows have. What all say
// of y once x is gone is known from coordinates in which the stiff row has one entry.
TEST(RowElimination, AStiffRowThatHardlyHasAColumnLeavesWeakOnesTheirDigits) {
  Eigen::MatrixXd rows(4, 3);  // of x₀, x₁, y
  rows << 0.7, 1e8, 6e7,       //
      0.8, 0.3, 0.9,           //
      0.6, 0.5, -0.4,          //
      -0.5, 0.7, 0.2;
  Exact turned = rows.cast<long double>();
  const long double of_y = turned(0, 2) / turned(0, 1), of_x = turned(0, 0) / turned(0, 1);
  turned.col(2) -= of_y * turned.col(1);
  turned.col(0) -= of_x * turned.col(1);
  turned.col(1) /= 1e8L;
  const auto expected = static_cast<double>(1.0L / (turned.transpose() * turned).inverse()(2, 2));
  for (const bool swapped : {false, true}) {
    Eigen::MatrixXd A(4, 4);
    A << rows, Eigen::VectorXd::Zero(4);
    if (swapped) {
      A.col(0).swap(A.col(1));
    }
    const EliminationOutcome outcome = EliminateColumns(2, 1e-14, &A);
    ASSERT_EQ(outcome.rank, 2);
    EXPECT_NEAR(A.col(2).tail(2).squaredNorm() / expected, 1.0, 1e-13) << swapped;
  }
}

// Columns in other units are as independent as before.
TEST(RowElimination, UnitsOfColumnsDecideNothingAboutTheRank) {
  for (const double unit : {1e-12, 1.0, 1e12}) {
    Eigen::MatrixXd A(4, 4);
    A << 1.0, 2.0, 3.0, 0.0,  //
        0.0, 1.0, 1.0, 0.0,   //
        1.0, 0.0, 1.0, 0.0,   //
        2.0, 1.0, 3.0, 0.0;
    A.col(1) *= unit;
    // The third is the sum of the first and, in its unit, the second.
    const EliminationOutcome outcome = EliminateColumns(3, 1e-10, &A);
    EXPECT_EQ(outcome.rank, 2) << unit;
    EXPECT_EQ(outcome.dependent.size(), 1U) << unit;
  }
}

}  // namespace
}  // namespace inceres::internal
