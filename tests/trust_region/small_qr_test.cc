#include "trust_region/small_qr.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "support/random_values.h"

namespace inceres::internal {
namespace {

struct Columns {
  Columns(const Eigen::MatrixXd& J, const Eigen::VectorXd& f, const Eigen::VectorXd& damping)
      : num_rows(static_cast<int>(J.rows())),
        values(Eigen::MatrixXd::Zero(DampedColumnStride(num_rows, static_cast<int>(J.cols())),
                                     J.cols() + 1)) {
    values.topRows(J.rows()) << J, f;
    values.block(J.rows(), 0, J.cols(), J.cols()) = damping.cwiseSqrt().asDiagonal();
  }

  Eigen::VectorXd Solve() {
    const auto size = static_cast<int>(values.cols()) - 1;
    Eigen::VectorXd scratch(2 * size + 1);
    Eigen::VectorXd x(size);
    SolveDampedColumns(num_rows, size, values.data(), scratch.data(), x.data());
    return x;
  }

  int num_rows;
  Eigen::MatrixXd values;
};

TEST(SolveDampedColumns, IsTheLeastSquaresSolution) {
  test::Random random(7);
  for (const int num_rows : {1, 2, 5, 53}) {
    for (int size = 1; size <= 16; ++size) {
      Eigen::MatrixXd J(num_rows, size);
      Eigen::VectorXd f(num_rows), damping(size);
      J = J.unaryExpr([&](double) { return random.Unit(); });
      f = f.unaryExpr([&](double) { return random.Unit(); });
      damping = damping.unaryExpr([&](double) { return random.Between(0.1, 2.0); });
      const Eigen::MatrixXd H = J.transpose() * J + Eigen::MatrixXd(damping.asDiagonal());
      const Eigen::VectorXd expected = -H.ldlt().solve(J.transpose() * f);
      const Eigen::VectorXd x = Columns(J, f, damping).Solve();
      EXPECT_LE((x - expected).norm(), 1e-12 * (1.0 + expected.norm()))
          << num_rows << " x " << size;
    }
  }
}

// Columns so alike that JᵀJ has lost their difference.
TEST(SolveDampedColumns, DoesNotSquareTheConditionNumber) {
  Eigen::MatrixXd J(3, 2);
  J << 1.0, 1.0, 1e-9, 0.0, 0.0, 1e-9;
  const Eigen::Vector2d solution(2.0, -3.0);
  const Eigen::VectorXd x = Columns(J, -J * solution, Eigen::Vector2d::Zero()).Solve();
  EXPECT_LE((x - solution).norm(), 1e-6);
}

TEST(SolveDampedColumns, OfDependentColumnsIsNotFinite) {
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(4, 2);
  J.col(0).setOnes();
  const Eigen::VectorXd x = Columns(J, Eigen::VectorXd::Ones(4), Eigen::Vector2d::Zero()).Solve();
  EXPECT_FALSE(x.allFinite());
}

}  // namespace
}  // namespace inceres::internal
