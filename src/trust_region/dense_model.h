#pragma once

#include <vector>

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

/// The same for DENSE_QR: the step is that of the rows, not of H (see DenseQrModel).
class DenseColumnsQrModel final : public DenseModel {
 public:
  explicit DenseColumnsQrModel(const Evaluator& evaluator);

  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override { return "dense QR"; }

 private:
  AlignedVector<double> reflected_;  // [J f; √Λ 0]
  std::vector<double> scratch_;
};

}  // namespace inceres::internal
