#pragma once

#include <cstdint>
#include <vector>

#include "inceres/status.h"
#include "linear/coarse_columns.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

/// VᵀA V of a coarse space, and its Cholesky factor.
class CoarseFactor {
 public:
  /// Fails as the analysis of the matrix.
  CoarseFactor(BlockPattern pattern, const Executor& executor, Status* status);

  const BlockPattern& pattern() const { return pattern_; }
  /// To be written before Factorize.
  double* values() { return values_.data(); }
  /// What rounding has left of the values is made positive definite.
  Status Factorize();
  /// x = (VᵀA V)⁻¹ b.
  void Solve(const double* b, double* x) { static_cast<void>(factor_.Solve(b, {}, {}, x)); }
  std::int64_t Bytes() const;

 private:
  const BlockPattern pattern_;
  std::vector<double> values_;
  std::vector<double> diagonal_;
  SparseCholesky factor_;
};

/// The coarse half of a two-level preconditioner for a symmetric positive definite A: V, A V, and
/// the Cholesky factor of the Galerkin product VᵀA V. Others write V and A V. Memory: A V, and the
/// factor.
class CoarseSpace : public CoarseColumns {
 public:
  /// `offsets`: first scalar of each block row of A, and the total. Fails as the analysis of the
  /// coarse matrix.
  CoarseSpace(const std::vector<int>& offsets, CoarseShape shape, const Executor& executor,
              Status* status);

  /// VᵀA V and its factor.
  Status Factorize();

  /// y = r − A V q with q = (VᵀA V)⁻¹ Vᵀ r, which is kept.
  void Deflate(const double* r, double* y);
  /// z += V (q − (VᵀA V)⁻¹ (A V)ᵀ z).
  void AddCoarse(double* z);

  std::int64_t Bytes() const;

 private:
  CoarseFactor factor_;
  std::vector<double> restricted_;
  std::vector<double> q_;
  std::vector<double> correction_;
};

}  // namespace inceres::internal
