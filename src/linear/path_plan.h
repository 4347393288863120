#pragma once

#include <cstddef>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "linear/block_paths.h"
#include "linear/pattern_rows.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// What is known from the pattern of S alone of a factorization that eliminates its paths first:
/// where each block of S goes, into the tiles of a path or into the rest, which is a matrix of the
/// nodes that are on no path.
class PathPlan {
 public:
  /// A block of S on its way: entry (r, c) goes to r · row_step + c · column_step behind `to`.
  struct Piece {
    int i, block;  // its row in S and its index in the pattern
    std::ptrdiff_t to;
    int row_step, column_step;
  };
  /// Where a path is kept, from what places on: tiles, sections of its nodes, of what is next and
  /// of the anchor, and the anchor's own block.
  struct Place {
    std::ptrdiff_t tiles = 0, vectors = 0, square = 0;
  };
  struct Path : BlockPaths::Path {
    Place at;
    int piece_begin = 0, piece_end = 0;  // among pieces()

    int num_nodes() const { return end - begin; }
    // In doubles.
    int section() const { return PadToQuad(size); }
    int stride() const { return 3 * section(); }  // from column to column of a tile
    std::ptrdiff_t tile_size() const { return std::ptrdiff_t{stride()} * size; }
  };

  PathPlan() = default;
  PathPlan(const BlockPattern& pattern, BlockPaths paths);

  const BlockPattern& pattern() const { return *pattern_; }
  const BlockPattern& rest_pattern() const { return rest_pattern_; }
  const std::vector<Path>& paths() const { return paths_; }
  const std::vector<Piece>& pieces() const { return pieces_; }  ///< path by path
  const std::vector<Piece>& rest_pieces() const { return rest_pieces_; }
  const Place& sizes() const { return sizes_; }  ///< of all paths together

  /// The row of the rest that a node is.
  int RestRow(int node) const { return index_[node]; }
  /// Where a block of the rest begins; row ≥ column.
  std::ptrdiff_t RestBlock(int row, int column) const {
    return rest_pattern_.value_begin[FindBlock(rest_pattern_, row, column)];
  }

  /// Calls visit(row of S, its first scalar in the node), of a node of a path or a row of the rest.
  template <typename Visit>
  void ForEachRowOfPath(int k, const Visit& visit) const {
    ForEachRow(found_.nodes[k], visit);
  }
  template <typename Visit>
  void ForEachRowOfRest(int row, const Visit& visit) const {
    ForEachRow(rest_nodes_[row], visit);
  }
  /// Calls visit(row of S, its first scalar in the rest), of all of it.
  template <typename Visit>
  void ForEachRowOfRest(const Visit& visit) const {
    for (int row = 0; row < rest_pattern_.num_blocks(); ++row) {
      ForEachRowOfRest(row,
                       [&](int i, int local) { visit(i, rest_pattern_.offsets[row] + local); });
    }
  }

  double flops() const { return flops_; }      ///< of the paths
  double entries() const { return entries_; }  ///< of the factor there
  std::size_t Bytes() const {
    return (pieces_.capacity() + rest_pieces_.capacity()) * sizeof(Piece);
  }

 private:
  template <typename Visit>
  void ForEachRow(int node, const Visit& visit) const {
    for (int k = found_.node_begin[node]; k < found_.node_begin[node + 1]; ++k) {
      visit(found_.blocks[k], local_[found_.blocks[k]]);
    }
  }
  void PlaceRows();
  void PlacePaths();
  void MakeRestPattern();
  void ListPieces();
  int PathOf(int i, int j) const;
  Piece PieceOnPath(int i, int j, int block) const;
  Piece PieceOfRest(int i, int j, int block) const;

  const BlockPattern* pattern_ = nullptr;
  BlockPaths found_;
  std::vector<Path> paths_;
  Place sizes_;
  std::vector<int> path_of_;  // per node; kNone: of the rest
  std::vector<int> index_;    // per node: on its path, or its row in the rest
  std::vector<int> local_;    // per row of S: its first scalar within its node
  std::vector<Piece> pieces_, rest_pieces_;
  std::vector<int> rest_nodes_;
  BlockPattern rest_pattern_;
  double flops_ = 0.0, entries_ = 0.0;
};

/// Whether the paths in S are worth a solver of their own: enough of its nodes are on long ones.
bool AreWorthEliminating(const BlockPaths& paths);

}  // namespace inceres::internal
