#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/block_paths.h"
#include "linear/sparse_cholesky.h"
#include "simd/small_kernels.h"

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
  double PredictedFlops() const { return path_flops_ + rest_.PredictedFlops(); }
  double PredictedEntries() const { return path_entries_ + rest_.PredictedEntries(); }
  /// Rows of S in the order of elimination.
  std::vector<int> order() const;

 private:
  // A block of S on its way: entry (r, c) goes to r · row_step + c · column_step behind `to`.
  struct Piece {
    int i, block;  // its row in S and its index in the pattern
    std::ptrdiff_t to;
    int row_step, column_step;
  };
  // Where a path is kept, and where what it leaves goes in the rest.
  struct Place {
    std::ptrdiff_t tiles = 0;    // its first tile; one more than nodes
    std::ptrdiff_t vectors = 0;  // sections of its nodes, of what is next and of the anchor
    std::ptrdiff_t square = 0;   // the anchor's own block
    int piece_begin = 0, piece_end = 0;
  };

  int Section(int p) const { return PadToQuad(paths_.paths[p].size); }
  std::ptrdiff_t TileSize(int p) const {
    return std::ptrdiff_t{3} * Section(p) * paths_.paths[p].size;
  }
  int num_paths() const { return static_cast<int>(paths_.paths.size()); }
  template <typename Visit>
  void ForEachRow(int node, const Visit& visit) const;
  template <typename Body>
  void ForPaths(const Body& body) const;

  void PlacePaths();
  void ListRestRows();
  void ListPieces();
  void MakeRestPattern();
  std::ptrdiff_t RestBlock(int row, int column) const;
  Piece PieceOnPath(int i, int j, int block) const;
  Piece PieceOfRest(int i, int j, int block) const;
  void PlacePiece(const Piece& piece, const ReducedMatrix& A, double* values) const;
  int EliminatePath(int p, const ReducedMatrix& A);
  void AddToRest(int p);
  void AddBlock(const double* from, int column_stride, int row, int column, int size);
  Status FactorizeRest(const ReducedMatrix& A);

  const Executor& executor_;
  const BlockPattern* pattern_ = nullptr;
  Status factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  BlockPaths paths_;
  std::vector<Place> places_;  // per path
  std::vector<int> path_of_;   // per node; kNone: of the rest
  std::vector<int> index_;     // per node: on its path, or its row in the rest
  std::vector<int> local_;     // per row of S: its first scalar within its node
  std::vector<Piece> pieces_, rest_pieces_;
  std::vector<int> rest_nodes_;  // per row of the rest
  BlockPattern rest_pattern_;
  SparseCholesky rest_;
  std::vector<int> failed_;  // per path: the scalar; -1: none
  AlignedVector<double> tiles_, squares_, vectors_;
  AlignedVector<double> rest_values_, rest_diagonal_, rest_b_, rest_x_;
  double path_flops_ = 0.0, path_entries_ = 0.0;
};

/// Whether the paths in S are worth a solver of their own: enough of its nodes are on long ones.
bool AreWorthEliminating(const BlockPaths& paths);

}  // namespace inceres::internal
