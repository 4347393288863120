#pragma once

#include <vector>

#include <Eigen/Core>

#include "base/aligned_vector.h"
#include "trust_region/linear_model.h"

namespace inceres::internal {

/// H = JᵀJ of a small problem whose Jacobians are whole rows (JacobianStorage::kWholeRows): [J f]
/// is kept as columns, of which everything is a dot product or a sum, and nothing is to be planned.
/// Single-threaded.
class DenseModel : public LinearModel {
 public:
  explicit DenseModel(const Evaluator& evaluator);

  void Refresh() override;
  const std::vector<double>& Gradient() const override { return gradient_; }
  const std::vector<double>& Diagonal() const override { return diagonal_; }
  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override { return "dense Cholesky"; }
  void Describe(WorkCounts* work) const override;

 protected:
  int size_;
  int num_rows_ = 0;               // of J
  int stride_;                     // of columns_
  AlignedVector<double> columns_;  // of [J f], zeros below

 private:
  RowProducts MultiplyJacobian(const double* v) override;
  template <typename Size>
  bool FactorAndSolve(Size size, const double* damping, double* step);
  VariableId VariableAt(int column) const;

  std::vector<double> H_;  // row-major, and Jᵀf as one more row; all of it negative
  std::vector<double> L_;
  std::vector<double> inverse_pivots_;
  std::vector<double> gradient_;
  std::vector<double> diagonal_;
};

/// The same for DENSE_QR: the step is that of the rows, not of H, as DenseQrModel's.
class DenseColumnsQrModel final : public DenseModel {
 public:
  explicit DenseColumnsQrModel(const Evaluator& evaluator);

  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override { return "dense QR"; }

 private:
  AlignedVector<double> reflected_;  // [J f; √Λ 0]
  std::vector<double> scratch_;
};

/// min ‖Jδ + f‖² + ‖√Λ δ‖² by Householder QR of the stacked rows [J; √Λ], without forming H: the
/// condition number is not squared. For small, ill-conditioned problems (curve fitting with
/// tolerances near machine precision) whose Jacobians are by slot. Single-threaded. Source: Golub &
/// Van Loan, section 5.3.
class DenseQrModel final : public LinearModel {
 public:
  explicit DenseQrModel(const Evaluator& evaluator);

  void Refresh() override;
  const std::vector<double>& Gradient() const override { return gradient_; }
  const std::vector<double>& Diagonal() const override { return diagonal_; }
  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override { return "dense QR"; }
  void Describe(WorkCounts* work) const override;

 private:
  int num_residuals_ = 0;
  Eigen::MatrixXd J_;  // rows of the evaluator's factors, family by family
  Eigen::VectorXd f_;
  Eigen::MatrixXd stacked_;
  std::vector<double> gradient_;
  std::vector<double> diagonal_;
};

}  // namespace inceres::internal
