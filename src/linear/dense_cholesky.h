#pragma once

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// L Lᵀ = S + diag, dense, column-major lower triangle, by panels of our own kernels: no BLAS, whose threads are process-wide and
/// would break both "one thread" and "same bits". Left-looking; the row strips of a panel are independent tasks. Cost: n³/3
/// flops. Source: Golub & Van Loan, section 4.2.
class DenseCholesky final : public ReducedSolver {
 public:
  explicit DenseCholesky(const Executor& executor) : executor_(executor) {}

  const char* Name() const override { return "dense Cholesky"; }
  Status Analyze(const BlockPattern& pattern) override;
  Status Factorize(const double* values, const double* diagonal) override;
  Status Solve(const double* b, double* x) override;

  /// Flops of one factorisation.
  double PredictedFlops() const { return static_cast<double>(size_) * size_ * size_ / 3.0; }
  std::size_t Bytes() const { return L_.capacity() * sizeof(double); }

 private:
  void CopyIn(const double* values, const double* diagonal);
  void UpdatePanel(int first, int width);
  bool FactorTriangle(int first, int width, int* failed);
  bool FactorDiagonalBlock(int first, int width, int* failed);
  void SolvePanel(int first, int width);
  double* Column(int j) { return L_.data() + static_cast<std::ptrdiff_t>(j) * stride_; }

  const Executor& executor_;
  const BlockPattern* pattern_ = nullptr;
  int size_ = 0;
  int padded_size_ = 0;  // to whole quads; below size_ the columns are zero
  int stride_ = 0;
  AlignedVector<double> L_;
  AlignedVector<double> solution_;
};

}  // namespace inceres::internal
