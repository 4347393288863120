#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/path_plan.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

/// L Lᵀ = S + diag where much of S is paths: these are eliminated first, each block by block in one
/// pass over a band, and what is left, where paths meet, is a smaller matrix for SparseCholesky.
/// The fill is the least that there is: a path leaves one block, between its two ends. Paths are
/// eliminated side by side, and what they leave is added in their order: the same bits for any
/// number of threads. Source: Rose, "A Graph-Theoretic Study of the Numerical Solution of Sparse
/// Positive Definite Systems of Linear Equations", 1972 (nodes of degree two).
class PathCholesky final : public ReducedSolver {
 public:
  explicit PathCholesky(const Executor& executor) : executor_(executor), rest_(executor) {}

  const char* Name() const override { return "sparse Cholesky, paths first"; }
  Status Analyze(const ReducedMatrix& A) override;
  /// Analyze, of paths that have been found already.
  Status Analyze(const BlockPattern& pattern, BlockPaths paths);
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override;
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  std::size_t Bytes() const override;

  /// Flops of one factorization, and entries of the factor.
  double PredictedFlops() const { return plan_.flops() + rest_.PredictedFlops(); }
  double PredictedEntries() const { return plan_.entries() + rest_.PredictedEntries(); }
  /// Rows of S in the order of elimination.
  std::vector<int> order() const;

 private:
  template <typename Body>
  void ForPaths(const Body& body) const;
  void PlacePiece(const PathPlan::Piece& piece, const ReducedMatrix& A, double* values) const;
  int EliminatePath(const PathPlan::Path& path, const ReducedMatrix& A);
  void AddToRest(const PathPlan::Path& path);
  void AddBlock(const double* from, int column_stride, int row, int column, int size,
                bool is_turned);
  Status FactorizeRest(const ReducedMatrix& A);
  int RowThatFails() const;
  void SolveForward(const PathPlan::Path& path, const double* b);
  Status SolveRest(const double* b, double* x);
  void SolveBackward(const PathPlan::Path& path, double* x);
  double* VectorsOf(const PathPlan::Path& path) { return vectors_.data() + path.at.vectors; }
  // Behind the nodes' sections: that of what is next, and the anchor's.
  double* NextOf(const PathPlan::Path& path) {
    return VectorsOf(path) + std::ptrdiff_t{path.num_nodes()} * path.section();
  }
  double* AnchorOf(const PathPlan::Path& path) { return NextOf(path) + path.section(); }

  const Executor& executor_;
  Status factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  PathPlan plan_;
  SparseCholesky rest_;
  std::vector<int> failed_;  // per path: the scalar; -1: none
  AlignedVector<double> tiles_, squares_, vectors_;
  AlignedVector<double> rest_values_, rest_diagonal_, rest_b_, rest_x_;
};

}  // namespace inceres::internal
