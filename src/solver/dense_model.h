#pragma once

#include <vector>

#include "base/aligned_vector.h"
#include "solver/linear_model.h"

namespace inceres::internal {

/// H = JᵀJ of a small problem whose Jacobians are whole rows (JacobianStorage::kWholeRows): one product a family, one small
/// Cholesky factor, and nothing to be planned. Single-threaded.
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

 private:
  VariableId VariableAt(int column) const;

  int stride_;               // of H and L: whole quads
  AlignedVector<double> H_;  // row-major, and Jᵀf as one more row
  AlignedVector<double> L_;
  std::vector<double> inverse_pivots_;
  std::vector<double> gradient_;
  std::vector<double> diagonal_;
};

/// The same for DENSE_QR: the step is that of the rows, not of H (see DenseQrModel).
class DenseRowsQrModel final : public DenseModel {
 public:
  explicit DenseRowsQrModel(const Evaluator& evaluator);

  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override { return "dense QR"; }

 private:
  int num_rows_ = 0;            // of J
  int stride_;                  // of rows_: whole quads
  AlignedVector<double> rows_;  // [J f; √Λ 0]
  std::vector<double> scratch_;
};

}  // namespace inceres::internal
