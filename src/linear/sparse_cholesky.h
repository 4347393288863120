#pragma once

#include <memory>

#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// Sparse Cholesky by CHOLMOD. The blocks are ordered by AMD or by nested dissection, whichever predicts fewer flops on the block
/// graph; the symbolic analysis is kept until the next Analyze. Source: Chen, Davis, Hager & Rajamanickam, "Algorithm 887:
/// CHOLMOD", ACM TOMS 35(3), 2008.
class SparseCholesky final : public ReducedSolver {
 public:
  SparseCholesky();
  ~SparseCholesky() override;
  SparseCholesky(const SparseCholesky&) = delete;
  SparseCholesky& operator=(const SparseCholesky&) = delete;

  const char* Name() const override;
  Status Analyze(const BlockPattern& pattern) override;
  Status Factorize(const double* values, const double* diagonal) override;
  Status Solve(const double* b, double* x) override;

  /// Flops of one factorisation, as predicted by the analysis.
  double PredictedFlops() const;
  /// Entries of the factor.
  double PredictedEntries() const;
  /// Whether the analysis found supernodes worth it: the arithmetic is then that of dense blocks.
  bool IsSupernodal() const;
  std::size_t Bytes() const;

 private:
  struct Cholmod;
  std::unique_ptr<Cholmod> cholmod_;
};

}  // namespace inceres::internal
