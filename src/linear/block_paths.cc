#include "linear/block_paths.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <utility>

#include "base/counting_sort.h"
#include "linear/block_neighbors.h"
#include "simd/kernels.h"

namespace inceres::internal {

// Which rows of S form paths (docs/algorithms.md, "Reduced linear systems"). Rows are joined to
// nodes where their closed neighborhoods, those coupled to them and themselves, are the same: by a
// hash, and then by comparison. Walks along nodes with two neighbors give the paths; in a ring, the
// node at which the walk began is taken out of it. All of it is a function of the pattern, and
// nodes are numbered by their first row.

namespace {

// Three nodes of the largest size, in scalars, less the row itself: with more neighbors a row is on
// no path.
constexpr int kMostNeighbors = 3 * kMostTileScalars - 1;

// Finds nodes first, then their neighbors, then paths. Cost: passes over the blocks of S, a sort of
// the rows by hash, and for each node a look at its neighbors until there are three.
class PathFinder {
 public:
  explicit PathFinder(const BlockPattern& pattern) : pattern_(pattern), graph_(pattern) {}

  BlockPaths Find() {
    JoinRows();
    FindNodeNeighbors();
    on_path_.resize(found_.num_nodes());
    for (int n = 0; n < found_.num_nodes(); ++n) {
      on_path_[n] = MayBeOnPath(n) ? 1 : 0;
    }
    is_taken_.assign(found_.num_nodes(), 0);
    for (int n = 0; n < found_.num_nodes(); ++n) {
      if (on_path_[n] != 0 && is_taken_[n] == 0) {
        Walk(n);
      }
    }
    return std::move(found_);
  }

 private:
  int num_rows() const { return pattern_.num_blocks(); }
  int NumNeighbors(int row) const { return graph_.begin[row + 1] - graph_.begin[row]; }

  // Of the closed neighborhood, whatever the order. A sum of mixed numbers, so that neighbors may
  // come in any order and the row itself counts as one of them: of rows that are coupled to each
  // other and to the same others it is the same. Equal hashes prove nothing, so AreAlike compares.
  std::uint64_t HashOf(int row) const {
    const auto mixed = [](int r) {
      std::uint64_t h = (static_cast<std::uint64_t>(r) + 1) * 0x9E3779B97F4A7C15u;
      h ^= h >> 32;
      return h * 0xD6E8FEB86659FD93u;
    };
    std::uint64_t sum = mixed(row);
    for (int k = graph_.begin[row]; k < graph_.begin[row + 1]; ++k) {
      sum += mixed(graph_.rows[k]);
    }
    return sum;
  }

  // The neighbors of both, ascending, walked side by side; each is left out of the other's list,
  // for they are coupled, and a closed neighborhood has both.
  bool AreAlike(int a, int b) const {
    if (NumNeighbors(a) != NumNeighbors(b)) {
      return false;
    }
    int i = graph_.begin[a], j = graph_.begin[b];
    while (i < graph_.begin[a + 1] || j < graph_.begin[b + 1]) {
      if (i < graph_.begin[a + 1] && graph_.rows[i] == b) {
        ++i;
      } else if (j < graph_.begin[b + 1] && graph_.rows[j] == a) {
        ++j;
      } else if (i < graph_.begin[a + 1] && j < graph_.begin[b + 1] &&
                 graph_.rows[i] == graph_.rows[j]) {
        ++i, ++j;
      } else {
        return false;
      }
    }
    return true;
  }

  // Rows by hash, then by number; a run of equal hashes is cut where rows are not alike after all,
  // or a node would be too large. A row is compared with the leader of the row before it, for what
  // is alike to one row of a node is so to all. Cut at kMostTileScalars, a long run of alike rows
  // becomes several nodes that are coupled to each other, and then mostly is no path.
  void JoinRows() {
    std::vector<std::pair<std::uint64_t, int>> by_hash;
    for (int row = 0; row < num_rows(); ++row) {
      if (NumNeighbors(row) <= kMostNeighbors) {
        by_hash.emplace_back(HashOf(row), row);
      }
    }
    std::sort(by_hash.begin(), by_hash.end());
    std::vector<int> first(num_rows());  // row of each row's node
    std::iota(first.begin(), first.end(), 0);
    int size = 0;
    for (std::size_t k = 0; k < by_hash.size(); ++k) {
      const int row = by_hash[k].second;
      const int leader =
          k > 0 && by_hash[k].first == by_hash[k - 1].first ? first[by_hash[k - 1].second] : row;
      const bool joins = leader != row && AreAlike(leader, row) &&
                         size + pattern_.block_size(row) <= kMostTileScalars;
      first[row] = joins ? leader : row;
      size = (joins ? size : 0) + pattern_.block_size(row);
    }
    NumberNodes(first);
  }

  // A leader is the first row of its node.
  void NumberNodes(const std::vector<int>& first) {
    found_.node_of.resize(num_rows());
    int num_nodes = 0;
    for (int row = 0; row < num_rows(); ++row) {
      found_.node_of[row] = first[row] == row ? num_nodes++ : found_.node_of[first[row]];
    }
    CountingSort(
        num_nodes,
        [this](const auto& add) {
          for (int row = 0; row < num_rows(); ++row) {
            add(found_.node_of[row], row);
          }
        },
        &found_.node_begin, &found_.blocks);
    found_.node_size.assign(num_nodes, 0);
    for (int row = 0; row < num_rows(); ++row) {
      found_.node_size[found_.node_of[row]] += pattern_.block_size(row);
    }
  }

  int SizeOf(int node) const { return found_.node_size[node]; }

  // Up to two of each node, and how many: 3 stands for all that is more. All rows of a node have
  // the same neighbors.
  void FindNodeNeighbors() {
    near_.resize(found_.num_nodes());
    for (int n = 0; n < found_.num_nodes(); ++n) {
      const int row = found_.blocks[found_.node_begin[n]];
      Near& near = near_[n];
      for (int k = graph_.begin[row]; k < graph_.begin[row + 1] && near.count < 3; ++k) {
        const int other = found_.node_of[graph_.rows[k]];
        if (other != n && !(near.count > 0 && near.node[0] == other) &&
            !(near.count > 1 && near.node[1] == other)) {
          if (near.count < 2) {
            near.node[near.count] = other;
          }
          ++near.count;
        }
      }
    }
  }

  // One or two neighbors, all of the same size as the node, for tiles of a path have one size. A
  // node without neighbors is a matrix by itself, and left to the rest.
  bool MayBeOnPath(int n) const {
    const Near& near = near_[n];
    const int size = SizeOf(n);
    const auto is_as_large = [&](int k) { return k >= near.count || SizeOf(near.node[k]) == size; };
    return near.count >= 1 && near.count <= 2 && size <= kMostTileScalars && is_as_large(0) &&
           is_as_large(1);
  }

  // Behind n, coming from `from`; kNone: it ends there.
  int Behind(int n, int from) const {
    const Near& near = near_[n];
    if (near.count < 2) {
      return near.node[0] == from ? BlockPaths::kNone : near.node[0];
    }
    return near.node[0] == from ? near.node[1] : near.node[0];
  }

  // From n on by way of `to`: the nodes on the path, and the one that it ends at.
  int Follow(int n, int to, std::vector<int>* nodes) const {
    int from = n;
    while (to != BlockPaths::kNone && on_path_[to] != 0 && to != n) {
      nodes->push_back(to);
      from = std::exchange(to, Behind(to, from));
    }
    return to;
  }

  // Both ways from n: to where a node that is on no path, or nothing, comes. In a ring the walk
  // comes back to n, which is then taken off the path and becomes both of its ends; nodes are taken
  // in their order, so which one it is follows from the pattern.
  void Walk(int n) {
    std::vector<int> nodes, back;
    const int next = Follow(n, near_[n].node[0], &nodes);
    if (next == n) {
      // A ring: n holds it together.
      on_path_[n] = 0;
      return Add(nodes, n, n);
    }
    const int anchor = near_[n].count == 2 ? Follow(n, near_[n].node[1], &back) : BlockPaths::kNone;
    std::reverse(back.begin(), back.end());
    back.push_back(n);
    back.insert(back.end(), nodes.begin(), nodes.end());
    Add(back, anchor, next);
  }

  // From the end that is free, if one is.
  void Add(std::vector<int> nodes, int anchor, int next) {
    if (next == BlockPaths::kNone) {
      std::reverse(nodes.begin(), nodes.end());
      std::swap(anchor, next);
    }
    for (const int node : nodes) {
      is_taken_[node] = 1;
    }
    const int begin = static_cast<int>(found_.nodes.size());
    found_.nodes.insert(found_.nodes.end(), nodes.begin(), nodes.end());
    found_.paths.push_back(
        {begin, static_cast<int>(found_.nodes.size()), anchor, next, SizeOf(nodes.front())});
  }

  struct Near {
    int count = 0;
    int node[2] = {BlockPaths::kNone, BlockPaths::kNone};
  };

  const BlockPattern& pattern_;
  const BlockNeighbors<int> graph_;
  BlockPaths found_;
  std::vector<Near> near_;  // per node
  std::vector<char> on_path_, is_taken_;
};

}  // namespace

BlockPaths FindBlockPaths(const BlockPattern& pattern) {
  return PathFinder(pattern).Find();
}

}  // namespace inceres::internal
