#pragma once

#include <cstddef>
#include <vector>

#include "inceres/linear/reduced_matrix.h"
#include "linear/block_paths.h"
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
    int piece_begin = 0, piece_end = 0;
  };

  PathPlan() = default;
  PathPlan(const BlockPattern& pattern, BlockPaths paths);

  const BlockPattern& pattern() const { return *pattern_; }
  const BlockPattern& rest_pattern() const { return rest_pattern_; }
  int num_paths() const { return static_cast<int>(paths_.paths.size()); }
  const BlockPaths::Path& path(int p) const { return paths_.paths[p]; }
  const Place& place(int p) const { return places_[p]; }
  const std::vector<Piece>& pieces() const { return pieces_; }  ///< path by path
  const std::vector<Piece>& rest_pieces() const { return rest_pieces_; }
  const Place& sizes() const { return sizes_; }  ///< of all paths together

  /// Nodes of a path, and in doubles a section and a tile of it.
  int NumNodes(int p) const { return path(p).end - path(p).begin; }
  int Section(int p) const { return PadToQuad(path(p).size); }
  std::ptrdiff_t TileSize(int p) const { return std::ptrdiff_t{3} * Section(p) * path(p).size; }
  /// The row of the rest that a node is.
  int RestRow(int node) const { return index_[node]; }
  /// Where a block of the rest begins; row ≥ column.
  std::ptrdiff_t RestBlock(int row, int column) const;

  /// Calls visit(row of S, its first scalar in the node), of a node of a path or a row of the rest.
  template <typename Visit>
  void ForEachRowOfPath(int k, const Visit& visit) const {
    ForEachRow(paths_.nodes[k], visit);
  }
  template <typename Visit>
  void ForEachRowOfRest(int row, const Visit& visit) const {
    ForEachRow(rest_nodes_[row], visit);
  }

  double flops() const { return flops_; }      ///< of the paths
  double entries() const { return entries_; }  ///< of the factor there
  std::size_t Bytes() const {
    return (pieces_.capacity() + rest_pieces_.capacity()) * sizeof(Piece);
  }

 private:
  template <typename Visit>
  void ForEachRow(int node, const Visit& visit) const {
    for (int k = paths_.node_begin[node]; k < paths_.node_begin[node + 1]; ++k) {
      visit(paths_.blocks[k], local_[paths_.blocks[k]]);
    }
  }
  void PlaceRows();
  void PlacePaths();
  void MakeRestPattern();
  void ListPieces();
  Piece PieceOnPath(int i, int j, int block) const;
  Piece PieceOfRest(int i, int j, int block) const;

  const BlockPattern* pattern_ = nullptr;
  BlockPaths paths_;
  std::vector<Place> places_;
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
