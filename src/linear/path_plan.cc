#include "linear/path_plan.h"

#include <algorithm>
#include <utility>

#include "base/counting_sort.h"
#include "base/sort_unique.h"

namespace inceres::internal {

// Where the blocks of S go when its paths are eliminated first (docs/algorithms.md, "Reduced linear
// systems"): a tile has the columns of a node of a path, in three sections, its own rows, those of
// the anchor, and those of the next node (simd/kernels.h); the rest is a matrix in whose
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
    : pattern_(&pattern), found_(std::move(paths)) {
  PlaceRows();
  PlacePaths();
  MakeRestPattern();
  ListPieces();
}

// Where each block row begins within its node, by the order of its rows.
void PathPlan::PlaceRows() {
  local_.assign(pattern_->num_blocks(), 0);
  for (int n = 0; n < found_.num_nodes(); ++n) {
    int size = 0;
    for (int k = found_.node_begin[n]; k < found_.node_begin[n + 1]; ++k) {
      local_[found_.blocks[k]] = size;
      size += pattern_->block_size(found_.blocks[k]);
    }
  }
}

// Paths one behind the other, then the nodes that are left as rows of the rest. One tile more than
// there are nodes, for what the path leaves at its end, and two sections more in vectors, for both
// ends. Flops and entries are those of full tiles with an anchor, and too many by its share for
// paths that have none.
void PathPlan::PlacePaths() {
  path_of_.assign(found_.num_nodes(), BlockPaths::kNone);
  index_.assign(found_.num_nodes(), 0);
  for (const BlockPaths::Path& found : found_.paths) {
    const Path path{found, sizes_};
    sizes_.tiles += (path.num_nodes() + 1) * path.tile_size();
    sizes_.vectors += std::ptrdiff_t{path.num_nodes() + 2} * path.section();
    sizes_.square += std::ptrdiff_t{path.size} * path.section();
    for (int k = path.begin; k < path.end; ++k) {
      path_of_[found_.nodes[k]] = static_cast<int>(paths_.size());
      index_[found_.nodes[k]] = k - path.begin;
    }
    const double d = path.size;
    flops_ += path.num_nodes() * d * d * d * (1.0 / 3.0 + 2.0 + 4.0);
    entries_ += path.num_nodes() * (0.5 * d * (d + 1.0) + 2.0 * d * d);
    paths_.push_back(path);
  }
  for (int n = 0; n < found_.num_nodes(); ++n) {
    if (path_of_[n] == BlockPaths::kNone) {
      index_[n] = static_cast<int>(rest_nodes_.size());
      rest_nodes_.push_back(n);
    }
  }
}

// The path that a block of S goes with, kNone: the rest. A block with one node on a path goes with
// that path; two nodes on different paths are never coupled, or the paths would have gone on.
int PathPlan::PathOf(int i, int j) const {
  return std::max(path_of_[found_.node_of[i]], path_of_[found_.node_of[j]]);
}

// The blocks of S between nodes of the rest, and those that paths leave between their ends. Pairs
// are sorted by row and column and made unique: several paths may have the same ends, or ends that
// S couples as well. Every node of the rest has a diagonal pair, from its own block rows, so each
// row of the pattern is closed by it. An anchor and a next that are one node, of a ring, add to the
// diagonal block, which is there.
void PathPlan::MakeRestPattern() {
  std::vector<std::pair<int, int>> pairs;
  const auto add = [&pairs](int a, int b) { pairs.emplace_back(std::max(a, b), std::min(a, b)); };
  ForEachBlock(*pattern_, [&](int i, int j, int /*block*/) {
    if (PathOf(i, j) == BlockPaths::kNone) {
      add(index_[found_.node_of[i]], index_[found_.node_of[j]]);
    }
  });
  for (const Path& path : paths_) {
    if (path.anchor != BlockPaths::kNone) {
      add(index_[path.anchor], index_[path.next]);
    }
  }
  SortUnique(&pairs);
  std::vector<int> offsets{0};
  for (const int node : rest_nodes_) {
    offsets.push_back(offsets.back() + found_.node_size[node]);
  }
  rest_pattern_ = PatternOf(std::move(offsets), pairs);
}

// By the tile that they go to, and those of the rest. Within a path pieces are sorted by where they
// go: tiles are then filled from front to back.
void PathPlan::ListPieces() {
  std::vector<int> begin;
  const auto for_each_on_path = [this](const auto& add) {
    ForEachBlock(*pattern_, [&](int i, int j, int k) {
      if (PathOf(i, j) != BlockPaths::kNone) {
        add(PathOf(i, j), PieceOnPath(i, j, k));
      }
    });
  };
  CountingSort(paths_.size(), for_each_on_path, &begin, &pieces_);
  for (std::size_t p = 0; p < paths_.size(); ++p) {
    paths_[p].piece_begin = begin[p];
    paths_[p].piece_end = begin[p + 1];
    std::sort(pieces_.begin() + begin[p], pieces_.begin() + begin[p + 1],
              [](const Piece& a, const Piece& b) { return a.to < b.to; });
  }
  ForEachBlock(*pattern_, [this](int i, int j, int k) {
    if (PathOf(i, j) == BlockPaths::kNone) {
      rest_pieces_.push_back(PieceOfRest(i, j, k));
    }
  });
}

// In the tile of the node that is eliminated first: which section, then the place in it. A block
// within a node lies in its own section; above the diagonal of the tile nothing is asked for. One
// with a later node of the path, or with the end behind the last node, is in the section for next;
// one with the anchor in the section for the anchor, which only the first node has in S: those of
// later nodes are fill.
PathPlan::Piece PathPlan::PieceOnPath(int i, int j, int block) const {
  const int a = found_.node_of[i], b = found_.node_of[j];
  const bool is_turned = path_of_[a] != BlockPaths::kNone && a != b &&
                         (path_of_[b] == BlockPaths::kNone || index_[a] < index_[b]);
  // Columns of the tile are those of `own`.
  const int own = is_turned ? a : b, other = is_turned ? b : a;
  const Path& path = paths_[path_of_[own]];
  const int section = path.section(), stride = path.stride();
  int at = 0;
  if (own != other) {
    const bool is_last = index_[own] == path.num_nodes() - 1;
    // Of a ring both ends have the same neighbor, and the last node comes by the section for next.
    const bool is_next =
        path_of_[other] != BlockPaths::kNone ||
        (is_last && other == path.next && !(index_[own] == 0 && path.anchor == other));
    at = is_next ? 2 * section : section;
  }
  const int row = local_[is_turned ? j : i], column = local_[is_turned ? i : j];
  return {
      i, block,
      path.at.tiles + index_[own] * path.tile_size() + std::ptrdiff_t{column} * stride + at + row,
      is_turned ? stride : 1, is_turned ? 1 : stride};
}

// Rows of a block in the rest are as long as its column node is large, since nodes join several
// block rows. Of two different nodes the later one has the block, so it is turned where S has it
// the other way around; within a node nothing is turned, for its rows ascend as those of S do.
PathPlan::Piece PathPlan::PieceOfRest(int i, int j, int block) const {
  const int a = index_[found_.node_of[i]], b = index_[found_.node_of[j]];
  const int row = std::max(a, b), column = std::min(a, b);
  const int stride = rest_pattern_.block_size(column);
  const bool is_turned = a < b;
  const int in_row = local_[is_turned ? j : i], in_column = local_[is_turned ? i : j];
  return {i, block, RestBlock(row, column) + std::ptrdiff_t{in_row} * stride + in_column,
          is_turned ? 1 : stride, is_turned ? stride : 1};
}

}  // namespace inceres::internal
