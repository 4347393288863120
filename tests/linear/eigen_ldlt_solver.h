#pragma once

#include <Eigen/Cholesky>

#include "inceres/linear/reduced_solver.h"

/// The example of docs/reduced_solver.md: a user's own solver of S δ = b, a dense LDLᵀ by Eigen.
// [quoted in docs/reduced_solver.md]
class EigenLdltSolver final : public inceres::ReducedSolver {
 public:
  const char* Name() const override { return "Eigen LDLT"; }

  // The pattern stays alive until the next Analyze, so keeping a pointer is enough.
  inceres::Status Analyze(const inceres::BlockPattern& pattern) override {
    pattern_ = &pattern;
    S_.setZero(pattern.size(), pattern.size());
    return inceres::Status::Ok();
  }

  inceres::Status Factorize(const double* values, const double* diagonal) override {
    using Block = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;
    for (int row = 0; row < pattern_->num_blocks(); ++row) {
      for (int k = pattern_->row_begin[row]; k < pattern_->row_begin[row + 1]; ++k) {
        const int column = pattern_->columns[k];
        const int rows = pattern_->block_size(row);
        const int columns = pattern_->block_size(column);
        S_.block(pattern_->offsets[row], pattern_->offsets[column], rows, columns) =
            Block(values + pattern_->value_begin[k], rows, columns);
      }
    }
    S_.diagonal() += Eigen::Map<const Eigen::VectorXd>(diagonal, pattern_->size());
    ldlt_.compute(S_);  // reads the lower triangle only
    if (ldlt_.info() != Eigen::Success || !ldlt_.isPositive() || !(ldlt_.vectorD().minCoeff() > 0.0)) {
      return inceres::Status::Error(inceres::StatusCode::kSingular, "the reduced system is not positive definite");
    }
    return inceres::Status::Ok();
  }

  inceres::Status Solve(const double* b, double* x) override {
    Eigen::Map<Eigen::VectorXd>(x, pattern_->size()) = ldlt_.solve(Eigen::Map<const Eigen::VectorXd>(b, pattern_->size()));
    return inceres::Status::Ok();
  }

 private:
  const inceres::BlockPattern* pattern_ = nullptr;
  Eigen::MatrixXd S_;
  Eigen::LDLT<Eigen::MatrixXd> ldlt_;
};
// [end of quote]
