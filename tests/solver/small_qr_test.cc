#include "solver/small_qr.h"

#include <cmath>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "block/kernels.h"
#include "support/random_values.h"

namespace inceres::internal {
namespace {

struct Rows {
  Rows(const Eigen::MatrixXd& J, const Eigen::VectorXd& f, const Eigen::VectorXd& damping)
      : num_rows(static_cast<int>(J.rows())), size(static_cast<int>(J.cols())), stride(PadToQuad(size + 1)) {
    values.assign(static_cast<std::size_t>((num_rows + size) * stride), 0.0);
    for (int r = 0; r < num_rows + size; ++r) {
      for (int c = 0; c < size && r < num_rows; ++c) {
        At(r, c) = J(r, c);
      }
      (r < num_rows ? At(r, size) : At(r, r - num_rows)) = r < num_rows ? f(r) : std::sqrt(damping(r - num_rows));
    }
  }

  double& At(int r, int c) { return values[static_cast<std::size_t>(r * stride + c)]; }

  Eigen::VectorXd Solve() {
    std::vector<double> scratch(static_cast<std::size_t>(num_rows + size));
    Eigen::VectorXd x(size);
    SolveDampedRows(num_rows, size, values.data(), stride, scratch.data(), x.data());
    return x;
  }

  int num_rows;
  int size;
  int stride;
  std::vector<double> values;
};

TEST(SolveDampedRows, IsTheLeastSquaresSolution) {
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
      const Eigen::VectorXd x = Rows(J, f, damping).Solve();
      EXPECT_LE((x - expected).norm(), 1e-12 * (1.0 + expected.norm())) << num_rows << " x " << size;
    }
  }
}

// Columns so alike that JᵀJ has lost their difference.
TEST(SolveDampedRows, DoesNotSquareTheConditionNumber) {
  Eigen::MatrixXd J(3, 2);
  J << 1.0, 1.0, 1e-9, 0.0, 0.0, 1e-9;
  const Eigen::Vector2d solution(2.0, -3.0);
  const Eigen::VectorXd x = Rows(J, -J * solution, Eigen::Vector2d::Zero()).Solve();
  EXPECT_LE((x - solution).norm(), 1e-6);
}

TEST(SolveDampedRows, OfDependentColumnsIsNotFinite) {
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(4, 2);
  J.col(0).setOnes();
  const Eigen::VectorXd x = Rows(J, Eigen::VectorXd::Ones(4), Eigen::Vector2d::Zero()).Solve();
  EXPECT_FALSE(x.allFinite());
}

}  // namespace
}  // namespace inceres::internal
