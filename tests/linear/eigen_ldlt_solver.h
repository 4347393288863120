#pragma once

#include <Eigen/Cholesky>

#include "inceres/linear/reduced_solver.h"

/// The example of docs/reduced_solver.md: a user's own solver of A δ = b, a dense LDLᵀ by Eigen.
// [quoted in docs/reduced_solver.md]
class EigenLdltSolver final : public inceres::ReducedSolver {
 public:
  const char* Name() const override { return "Eigen LDLT"; }

  inceres::Status Factorize(const inceres::ReducedMatrix& A, const Rows& /*changed*/) override {
    const inceres::BlockPattern& pattern = A.pattern();
    Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(pattern.size(), pattern.size());
    A.ForEachBlock([&](int i, int j, const double* block, int stride) {
      using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      const int rows = pattern.block_size(i), columns = pattern.block_size(j);
      dense.block(pattern.offsets[i], pattern.offsets[j], rows, columns) =
          Eigen::Map<const Block, 0, Eigen::OuterStride<>>(block, rows, columns,
                                                           Eigen::OuterStride<>(stride));
    });
    dense.diagonal() += Eigen::Map<const Eigen::VectorXd>(A.diagonal(), pattern.size());
    ldlt_.compute(dense);  // reads the lower triangle only
    if (ldlt_.info() != Eigen::Success || !ldlt_.isPositive() ||
        !(ldlt_.vectorD().minCoeff() > 0.0)) {
      return inceres::Status::Error(inceres::StatusCode::kSingular,
                                    "the reduced system is not positive definite");
    }
    return inceres::Status::Ok();
  }

  inceres::Status Solve(const double* b, const Rows& /*changed*/, const Truncation& /*truncation*/,
                        double* x) override {
    const Eigen::Index size = ldlt_.rows();
    Eigen::Map<Eigen::VectorXd>(x, size) = ldlt_.solve(Eigen::Map<const Eigen::VectorXd>(b, size));
    return inceres::Status::Ok();
  }

 private:
  Eigen::LDLT<Eigen::MatrixXd> ldlt_;
};
// [end of quote]
