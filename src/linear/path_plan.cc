#include "linear/path_plan.h"

#include <algorithm>
#include <utility>

#include "base/counting_sort.h"
#include "base/sort_unique.h"

namespace inceres::internal {

// Where the blocks of S go when its paths are eliminated first (docs/algorithms.md, "Reduced linear
// systems"): a tile has the columns of a node of a path, in three sections, its own rows, those of
// the anchor, and those of the next node (simd/small_kernels.h); the rest is a matrix in whose
// pattern the two ends of a path are coupled. Done once for a structure.
//
// A plan is a list of pieces, each a block of S with the address of its first entry in the tiles or
// in the rest, and two steps: a factorization then copies, and asks nothing. Sections are padded to
// quads, so that the kernels' vectors begin on their boundaries; a tile has three in each column.

namespace {

// Of all nodes: those on paths, less two for each path, which is what its ends take.
constexpr double kLeastShare = 0.25;

}  // namespace

// A path of n nodes makes the rest smaller by n, and what it leaves at its two ends is work again:
// short ones do not count.
bool AreWorthEliminating(const BlockPaths& paths) {
  const double saved =
      static_cast<double>(paths.nodes.size()) - 2.0 * static_cast<double>(paths.paths.size());
  return saved > kLeastShare * paths.num_nodes();
}

PathPlan::PathPlan(const BlockPattern& pattern, BlockPaths paths)
    : pattern_(&pattern), paths_(std::move(paths)) {
  PlaceRows();
  PlacePaths();
  MakeRestPattern();
  ListPieces();
}

// Where each block row begins within its node, by the order of its rows.
void PathPlan::PlaceRows() {
  local_.assign(pattern_->num_blocks(), 0);
  for (int n = 0; n < paths_.num_nodes(); ++n) {
    int size = 0;
    for (int k = paths_.node_begin[n]; k < paths_.node_begin[n + 1]; ++k) {
      local_[paths_.blocks[k]] = size;
      size += pattern_->block_size(paths_.blocks[k]);
    }
  }
}

// Paths one behind the other, then the nodes that are left as rows of the rest. One tile more than
// there are nodes, for what the path leaves at its end, and two sections more in vectors, for both
// ends. Flops and entries are those of full tiles with an anchor, and too many by its share for
// paths that have none.
void PathPlan::PlacePaths() {
  path_of_.assign(paths_.num_nodes(), BlockPaths::kNone);
  index_.assign(paths_.num_nodes(), 0);
  for (int p = 0; p < num_paths(); ++p) {
    places_.push_back(sizes_);
    sizes_.tiles += (NumNodes(p) + 1) * TileSize(p);
    sizes_.vectors += std::ptrdiff_t{NumNodes(p) + 2} * Section(p);
    sizes_.square += std::ptrdiff_t{path(p).size} * Section(p);
    for (int k = path(p).begin; k < path(p).end; ++k) {
      path_of_[paths_.nodes[k]] = p;
      index_[paths_.nodes[k]] = k - path(p).begin;
    }
    const double d = path(p).size;
    flops_ += NumNodes(p) * d * d * d * (1.0 / 3.0 + 2.0 + 4.0);
    entries_ += NumNodes(p) * (0.5 * d * (d + 1.0) + 2.0 * d * d);
  }
  for (int n = 0; n < paths_.num_nodes(); ++n) {
    if (path_of_[n] == BlockPaths::kNone) {
      index_[n] = static_cast<int>(rest_nodes_.size());
      rest_nodes_.push_back(n);
    }
  }
}

// The blocks of S between nodes of the rest, and those that paths leave between their ends. Pairs
// are sorted by row and column and made unique: several paths may have the same ends, or ends that
// S couples as well. Every node of the rest has a diagonal pair, from its own block rows, so each
// row of the pattern is closed by it. An anchor and a next that are one node, of a ring, add to the
// diagonal block, which is there.
void PathPlan::MakeRestPattern() {
  std::vector<std::pair<int, int>> pairs;
  const auto add = [&pairs](int a, int b) { pairs.emplace_back(std::max(a, b), std::min(a, b)); };
  for (int i = 0; i < pattern_->num_blocks(); ++i) {
    const int row = paths_.node_of[i];
    for (int k = pattern_->row_begin[i];
         path_of_[row] == BlockPaths::kNone && k < pattern_->row_begin[i + 1]; ++k) {
      const int column = paths_.node_of[pattern_->columns[k]];
      if (path_of_[column] == BlockPaths::kNone) {
        add(index_[row], index_[column]);
      }
    }
  }
  for (const BlockPaths::Path& path : paths_.paths) {
    if (path.anchor != BlockPaths::kNone) {
      add(index_[path.anchor], index_[path.next]);
    }
  }
  SortUnique(&pairs);
  rest_pattern_.offsets.assign(1, 0);
  for (const int node : rest_nodes_) {
    int size = 0;
    ForEachRow(node, [&](int row, int) { size += pattern_->block_size(row); });
    rest_pattern_.offsets.push_back(rest_pattern_.offsets.back() + size);
  }
  // A row's own block is its last pair.
  rest_pattern_.row_begin.assign(1, 0);
  rest_pattern_.value_begin.assign(1, 0);
  for (const auto& [row, column] : pairs) {
    rest_pattern_.columns.push_back(column);
    rest_pattern_.value_begin.push_back(rest_pattern_.value_begin.back() +
                                        std::int64_t{rest_pattern_.block_size(row)} *
                                            rest_pattern_.block_size(column));
    if (row == column) {
      rest_pattern_.row_begin.push_back(static_cast<int>(rest_pattern_.columns.size()));
    }
  }
}

// Where a block of the rest begins; row ≥ column.
std::ptrdiff_t PathPlan::RestBlock(int row, int column) const {
  const auto begin = rest_pattern_.columns.begin();
  const auto at = std::lower_bound(begin + rest_pattern_.row_begin[row],
                                   begin + rest_pattern_.row_begin[row + 1], column);
  return rest_pattern_.value_begin[at - begin];
}

// By the tile that they go to, and those of the rest. A block with one node on a path goes with
// that path; two nodes on different paths are never coupled, or the paths would have gone on.
// Within a path pieces are sorted by where they go: tiles are then filled from front to back.
void PathPlan::ListPieces() {
  std::vector<int> begin;
  const auto for_each_on_path = [this](const auto& add) {
    for (int i = 0; i < pattern_->num_blocks(); ++i) {
      for (int k = pattern_->row_begin[i]; k < pattern_->row_begin[i + 1]; ++k) {
        const int j = pattern_->columns[k];
        const int p = std::max(path_of_[paths_.node_of[i]], path_of_[paths_.node_of[j]]);
        if (p != BlockPaths::kNone) {
          add(p, PieceOnPath(i, j, k));
        }
      }
    }
  };
  CountingSort(paths_.paths.size(), for_each_on_path, &begin, &pieces_);
  for (int p = 0; p < num_paths(); ++p) {
    places_[p].piece_begin = begin[p];
    places_[p].piece_end = begin[p + 1];
    std::sort(pieces_.begin() + begin[p], pieces_.begin() + begin[p + 1],
              [](const Piece& a, const Piece& b) { return a.to < b.to; });
  }
  for (int i = 0; i < pattern_->num_blocks(); ++i) {
    for (int k = pattern_->row_begin[i]; k < pattern_->row_begin[i + 1]; ++k) {
      const int j = pattern_->columns[k];
      if (path_of_[paths_.node_of[i]] == BlockPaths::kNone &&
          path_of_[paths_.node_of[j]] == BlockPaths::kNone) {
        rest_pieces_.push_back(PieceOfRest(i, j, k));
      }
    }
  }
}

// In the tile of the node that is eliminated first: which section, then the place in it. A block
// within a node lies in its own section; above the diagonal of the tile nothing is asked for. One
// with a later node of the path, or with the end behind the last node, is in the section for next;
// one with the anchor in the section for the anchor, which only the first node has in S: those of
// later nodes are fill.
PathPlan::Piece PathPlan::PieceOnPath(int i, int j, int block) const {
  const int a = paths_.node_of[i], b = paths_.node_of[j];
  const bool is_turned = path_of_[a] != BlockPaths::kNone && a != b &&
                         (path_of_[b] == BlockPaths::kNone || index_[a] < index_[b]);
  // Columns of the tile are those of `own`.
  const int own = is_turned ? a : b, other = is_turned ? b : a;
  const int p = path_of_[own];
  const BlockPaths::Path& path = paths_.paths[p];
  const int section = Section(p), stride = 3 * section;
  int at = 0;
  if (own != other) {
    const bool is_last = index_[own] == path.end - path.begin - 1;
    // Of a ring both ends have the same neighbor, and the last node comes by the section for next.
    const bool is_next =
        path_of_[other] != BlockPaths::kNone ||
        (is_last && other == path.next && !(index_[own] == 0 && path.anchor == other));
    at = is_next ? 2 * section : section;
  }
  const int row = local_[is_turned ? j : i], column = local_[is_turned ? i : j];
  return {i, block,
          places_[p].tiles + index_[own] * TileSize(p) + std::ptrdiff_t{column} * stride + at + row,
          is_turned ? stride : 1, is_turned ? 1 : stride};
}

// Rows of a block in the rest are as long as its column node is large, since nodes join several
// block rows. Of two different nodes the later one has the block, so it is turned where S has it
// the other way around; within a node nothing is turned, for its rows ascend as those of S do.
PathPlan::Piece PathPlan::PieceOfRest(int i, int j, int block) const {
  const int a = index_[paths_.node_of[i]], b = index_[paths_.node_of[j]];
  const int row = std::max(a, b), column = std::min(a, b);
  const int stride = rest_pattern_.block_size(column);
  const bool is_turned = a < b;
  const int in_row = local_[is_turned ? j : i], in_column = local_[is_turned ? i : j];
  return {i, block, RestBlock(row, column) + std::ptrdiff_t{in_row} * stride + in_column,
          is_turned ? 1 : stride, is_turned ? stride : 1};
}

}  // namespace inceres::internal
