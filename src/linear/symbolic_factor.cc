#include "linear/symbolic_factor.h"

#include <amd.h>
#include <camd.h>
#include <metis.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numeric>
#include <utility>

#include "base/counting_sort.h"
#include "linear/block_neighbors.h"
#include "linear/group_order.h"
#include "linear/pattern_rows.h"
#include "simd/kernels.h"

namespace inceres::internal {

// The order of the block rows of S and the fronts of its factor (docs/algorithms.md, "Reduced
// linear systems"). Everything is counted in blocks, which are taken to be of the mean size: the
// graph is smaller by the square of that, and blocks of frames are of few sizes.
//
// Four steps: an order with little fill (AMD, or AMD in the parts of a dissection); the elimination
// tree and the counts of the columns, by walking the row subtrees (Liu 1990); a postorder, in which
// columns that may share a front are neighbors; fronts, first those of exactly equal structure,
// then joined where the zeros that this brings cost less than the smaller front would.
//
// parents_ and counts_ are those of the exact factor throughout. A joined front is a range of
// positions whose last column has the rows of all: it holds the others' rows because in a chain of
// parents each column's rows, but for the next one, are among those of its parent.
//
// All of it is a function of the pattern. METIS draws random numbers and gets a seed for each call.

namespace {

// Cutting the graph once takes milliseconds where AMD takes one: only a factor this expensive may
// win that back within a solve.
constexpr double kMinFlopsForDissection = 3e7;
// Cutting it to the end takes half a microsecond a block of S, and a factorization does this many
// flops in one or two: it is tried where it takes no longer than half of a factorization.
constexpr double kFlopsPerBlockForParts = 5e4;
// Parts as small as this are not cut: of 60 to 250 blocks the flops differ by a few in a hundred,
// on cities of 1,000 to 11,000 cameras, photo collections and pose graphs.
constexpr int kSmallestCut = 120;
// The halves are factored side by side, which a chain's AMD order would not allow: worth these
// flops more.
constexpr double kWorthOfHalves = 1.05;

// When a front is joined with its parent: up to so many scalar columns of both, while zeros make up
// less than such a share of their entries; the first without a limit, and without their zeros being
// counted; the last share whatever the columns. The rule, and the shares, are those of CHOLMOD's
// analysis, whose columns are 4, 16 and 48; these are 4, 8 and 16 frames of 6.
constexpr double kJoinedColumns[] = {24.0, 48.0, 96.0};
constexpr double kZeroShare[] = {0.8, 0.1, 0.05};

// Where blocks are as small as poses a front is not joined, either, if the flops on zeros cost more
// than it saves, as in a chain: of larger ones a wider front makes up for them. In flops: what a
// front takes besides, and what an entry of it or of its update matrix does, zeroed, added, read.
constexpr double kSmallBlock = 6.0;
constexpr double kPriceOfFront = 2000.0;
constexpr double kPriceOfEntry = 4.0;

// Both directions of each edge, without loops, which is what METIS takes.
using Graph = BlockNeighbors<idx_t>;

// Per block 0 or 1, its half, or 2, the separator. Empty where METIS finds none. METIS draws lots:
// on a sphere of 2,500 poses it cuts so that the factor takes 1.0, 1.11 or 1.14 times the flops of
// the best, on other graphs 0.98 to 1.1; with this seed it finds the best on the sphere, and on the
// others what it finds mostly.
std::vector<idx_t> CutInHalves(Graph graph) {
  auto n = static_cast<idx_t>(graph.begin.size()) - 1;
  idx_t separator_size = 0;
  std::vector<idx_t> part(n);
  idx_t options[METIS_NOPTIONS];
  METIS_SetDefaultOptions(options);
  options[METIS_OPTION_SEED] = 10;
  // the lots are those of rand(), which all threads share, begun anew with each call
  static std::mutex mutex;
  const std::lock_guard<std::mutex> lock(mutex);
  const int result = METIS_ComputeVertexSeparator(&n, graph.begin.data(), graph.rows.data(),
                                                  nullptr, options, &separator_size, part.data());
  return result == METIS_OK ? part : std::vector<idx_t>();
}

// Nested dissection: a part of more blocks than `smallest_cut` is cut into two halves and a
// separator, which comes behind both, and the halves likewise. Source: George, "Nested Dissection
// of a Regular Finite Element Mesh", SIAM J. Numer. Anal. 10(2), 1973.
class Dissection {
 public:
  Dissection(const BlockPattern& pattern, int smallest_cut)
      : graph_(pattern),
        smallest_cut_(smallest_cut),
        place_(pattern.num_blocks(), -1),
        classes_(pattern.num_blocks()) {
    std::vector<int> all(pattern.num_blocks());
    std::iota(all.begin(), all.end(), 0);
    Cut(all);
  }

  /// Per block the number of its part or separator, in the order of elimination.
  const std::vector<int>& classes() const { return classes_; }
  bool has_cut() const { return num_classes_ > 1; }

 private:
  void Cut(const std::vector<int>& blocks) {
    const std::vector<idx_t> half = static_cast<int>(blocks.size()) > smallest_cut_
                                        ? CutInHalves(Between(blocks))
                                        : std::vector<idx_t>();
    std::vector<int> parts[3];
    for (std::size_t k = 0; k < half.size(); ++k) {
      parts[half[k]].push_back(blocks[k]);
    }
    if (parts[0].empty() || parts[1].empty()) {  // uncut
      return EndClass(blocks);
    }
    Cut(parts[0]);
    Cut(parts[1]);
    EndClass(parts[2]);
  }

  void EndClass(const std::vector<int>& blocks) {
    for (const int block : blocks) {
      classes_[block] = num_classes_;
    }
    num_classes_ += blocks.empty() ? 0 : 1;
  }

  // The graph between these blocks, by their places in the list.
  Graph Between(const std::vector<int>& blocks) {
    for (std::size_t k = 0; k < blocks.size(); ++k) {
      place_[blocks[k]] = static_cast<int>(k);
    }
    Graph part;
    part.begin.push_back(0);
    for (const int block : blocks) {
      for (idx_t n = graph_.begin[block]; n < graph_.begin[block + 1]; ++n) {
        if (const int place = place_[graph_.rows[n]]; place >= 0) {
          part.rows.push_back(place);
        }
      }
      part.begin.push_back(static_cast<idx_t>(part.rows.size()));
    }
    for (const int block : blocks) {
      place_[block] = -1;
    }
    return part;
  }

  const Graph graph_;
  const int smallest_cut_;
  std::vector<int> place_;  // per block, in the part that is cut; -1: not in it
  std::vector<int> classes_;
  int num_classes_ = 0;
};

// The lower triangle by rows is the upper one by columns, which AMD takes.
bool OrderByAmd(const BlockPattern& pattern, std::vector<int>* order) {
  order->resize(pattern.num_blocks());
  return amd_order(pattern.num_blocks(), pattern.row_begin.data(), pattern.columns.data(),
                   order->data(), nullptr, nullptr) >= AMD_OK;
}

// AMD within each class, which knows what comes after: all of a class before the next one.
bool OrderByClasses(const BlockPattern& pattern, std::vector<int> classes,
                    std::vector<int>* order) {
  order->resize(pattern.num_blocks());
  return camd_order(pattern.num_blocks(), pattern.row_begin.data(), pattern.columns.data(),
                    order->data(), nullptr, nullptr, classes.data()) >= CAMD_OK;
}

// AMD within the parts.
bool OrderByParts(const BlockPattern& pattern, int smallest_cut, std::vector<int>* order) {
  const Dissection dissection(pattern, smallest_cut);
  return dissection.has_cut() && OrderByClasses(pattern, dissection.classes(), order);
}

// The caller's groups, where he has any. The postorder that follows moves what is in different
// branches of the tree only: no row comes before one of a lower group that it is coupled to.
bool OrderRows(const BlockPattern& pattern, std::vector<int>* order) {
  return pattern.groups.empty() ? OrderByAmd(pattern, order)
                                : OrderByClasses(pattern, RanksOf(pattern.groups), order);
}

// The elimination tree of S in an order, and how many entries each column of the factor has.
// Cost of the construction: the entries of the factor in blocks, since each is met once in a row
// subtree.
class EliminationTree {
 public:
  EliminationTree(const BlockPattern& pattern, std::vector<int> order)
      : pattern_(pattern), order_(std::move(order)) {
    FindNeighbors();
    FindParents();
    PutInPostorder();
  }

  // Of a factorization by blocks of the mean size.
  // A column of c entries updates half of c² blocks, each by size³ multiplications and as many
  // additions.
  double Flops() const {
    const double mean_size = MeanSize();
    double flops = 0.0;
    for (const double count : counts_) {
      flops += count * count;
    }
    return flops * mean_size * mean_size * mean_size;
  }

  void FindFronts(SymbolicFactor* factor) {
    factor->order = order_;
    // Before joining: zeros do not count, so that two orders are compared by their fill alone.
    factor->flops = Flops();
    FindFundamentalFronts();
    JoinFronts();
    ListRows(factor);
  }

 private:
  int size() const { return static_cast<int>(order_.size()); }
  double MeanSize() const { return static_cast<double>(pattern_.size()) / pattern_.num_blocks(); }

  // By position: those before it.
  void FindNeighbors() {
    std::vector<int> position(size());
    for (int at = 0; at < size(); ++at) {
      position[order_[at]] = at;
    }
    const auto for_each_pair = [&](const auto& add) {
      ForEachCoupling(pattern_, [&](int i, int j) {
        const auto [first, second] = std::minmax(position[i], position[j]);
        add(second, first);
      });
    };
    CountingSort(size(), for_each_pair, &neighbors_begin_, &neighbors_);
  }

  // A row of the factor has entries in the columns on the paths of the tree from those of S up to
  // the diagonal.
  // last_row tells where this row has been already: the path from there on was walked for an
  // earlier entry. A column whose parent is not known gets it now, as rows come in ascending order
  // and the first one below the diagonal is the parent.
  void FindParents() {
    parents_.assign(size(), -1);
    counts_.assign(size(), 1);
    std::vector<int> last_row(size());
    for (int row = 0; row < size(); ++row) {
      last_row[row] = row;
      for (int k = neighbors_begin_[row]; k < neighbors_begin_[row + 1]; ++k) {
        for (int column = neighbors_[k]; last_row[column] != row; column = parents_[column]) {
          last_row[column] = row;
          ++counts_[column];
          parents_[column] = parents_[column] < 0 ? row : parents_[column];
        }
      }
    }
  }

  // Children before parents, the one with the most entries last: its column is then likely to join
  // its parent's.
  void PutInPostorder() {
    std::vector<int> by_count(size());
    std::iota(by_count.begin(), by_count.end(), 0);
    std::stable_sort(by_count.begin(), by_count.end(),
                     [this](int a, int b) { return counts_[a] < counts_[b]; });
    std::vector<int> first_child(size(), -1), next(size(), -1);
    std::vector<int> waiting;  // top last
    // Each child goes to the head of its list, largest first, so that the lists ascend.
    for (auto child = by_count.rbegin(); child != by_count.rend(); ++child) {
      if (parents_[*child] >= 0) {
        next[*child] = first_child[parents_[*child]];
        first_child[parents_[*child]] = *child;
      }
    }
    std::vector<int> postorder;
    // By a stack of our own: a chain of thousands of poses is a tree as deep.
    for (int root = 0; root < size(); ++root) {
      if (parents_[root] >= 0) {
        continue;
      }
      for (waiting.assign(1, root); !waiting.empty();) {
        const int top = waiting.back();
        if (first_child[top] >= 0) {
          waiting.push_back(first_child[top]);
          // The child leaves the list as it is pushed; a node without children left is done.
          first_child[top] = next[first_child[top]];
        } else {
          postorder.push_back(top);
          waiting.pop_back();
        }
      }
    }
    Permute(postorder);
  }

  // A postorder is an equivalent order: fill, counts and the tree are the same, renumbered; only
  // neighbors have to be listed anew.
  void Permute(const std::vector<int>& postorder) {
    std::vector<int> position(size());
    for (int at = 0; at < size(); ++at) {
      position[postorder[at]] = at;
    }
    const std::vector<int> order = order_, parents = parents_, counts = counts_;
    for (int at = 0; at < size(); ++at) {
      order_[at] = order[postorder[at]];
      counts_[at] = counts[postorder[at]];
      const int parent = parents[postorder[at]];
      parents_[at] = parent < 0 ? -1 : position[parent];
    }
    FindNeighbors();
  }

  // A column and the next that has the same rows but its own, and no other child.
  // With one child and one entry less the structures are equal, which needs no comparison of rows.
  void FindFundamentalFronts() {
    std::vector<int> num_children(size(), 0);
    for (const int parent : parents_) {
      if (parent >= 0) {
        ++num_children[parent];
      }
    }
    begin_.clear();
    for (int at = 0; at < size(); ++at) {
      if (at == 0 || parents_[at - 1] != at || counts_[at - 1] != counts_[at] + 1 ||
          num_children[at] != 1) {
        begin_.push_back(at);
      }
    }
    begin_.push_back(size());
  }

  // From the end: a front may join the one behind it, as it is by then, if that is its parent.
  // Its last column is the parent's child that comes right before it, so that what is joined stays
  // a range. zeros are those of the joined front so far; where columns are few they are not counted
  // at all.
  void JoinFronts() {
    std::vector<int> begin{size(),
                           begin_[begin_.size() - 2]};  // of the fronts that stay, from the end
    double zeros = 0.0;                                 // in the last of them
    for (auto f = static_cast<int>(begin_.size()) - 3; f >= 0; --f) {
      const int next = begin.back(), end = begin[begin.size() - 2];
      const int parent = parents_[next - 1];
      const double new_zeros = NewZeros(begin_[f], next, end);
      // The root's parent is −1, and a front may be followed by one that is no relative.
      if (parent >= next && parent < end &&
          IsWorthJoining(begin_[f], end, new_zeros, zeros + new_zeros) &&
          !IsDearer(begin_[f], next, end)) {
        begin.back() = begin_[f];
        zeros += new_zeros;
      } else {
        begin.push_back(begin_[f]);
        zeros = 0.0;
      }
    }
    begin_.assign(begin.rbegin(), begin.rend());
  }
  // Those of a front [begin, next) that joins the one behind it, up to `end`, as far as they count.
  // The front is fundamental, so all of its columns lack the same rows of the joined one.
  double NewZeros(int begin, int next, int end) const {
    return IsNarrow(end - begin, 0)
               ? 0.0
               : static_cast<double>(next - begin) * (RowsOf(begin, end) - counts_[begin]);
  }
  // The share is of the entries of the joined front, a trapezoid.
  bool IsWorthJoining(int begin, int end, double new_zeros, double zeros) const {
    const int columns = end - begin;
    const double share = zeros / (columns * (0.5 * (columns + 1) + RowsOf(begin, end) - columns));
    return new_zeros == 0.0 || (IsNarrow(columns, 1) && share < kZeroShare[0]) ||
           (IsNarrow(columns, 2) && share < kZeroShare[1]) || share < kZeroShare[2];
  }
  // Whether the fronts [begin, next) and [next, end) cost less than both as one.
  bool IsDearer(int begin, int next, int end) const {
    return MeanSize() <= kSmallBlock && Price(begin, end) > Price(begin, next) + Price(next, end);
  }
  // In scalars and padded, as front_elimination.cc will do it: flops of the elimination, entries
  // that are zeroed, added and read, and a price for the front itself.
  double Price(int begin, int end) const {
    const int columns = end - begin;
    const double w = PadToQuad(static_cast<int>(std::ceil(MeanSize() * columns)));
    const double h =
        PadToQuad(static_cast<int>(std::ceil(MeanSize() * (RowsOf(begin, end) - columns))));
    return kPriceOfFront + kPriceOfEntry * (w * (0.5 * w + h) + 0.5 * h * h) +
           w * (w * (w / 3.0 + h) + h * h);
  }
  bool IsNarrow(int columns, int limit) const {
    return columns <= std::ceil(kJoinedColumns[limit] / MeanSize());
  }
  // Of a front with these pivots: those, and the rows of the last column below it.
  int RowsOf(int begin, int end) const { return end - begin + counts_[end - 1] - 1; }

  // Below its pivots a front has the rows of S there and those of its children.
  // A row that crosses a front anywhere is a row of all of it.
  void ListRows(SymbolicFactor* factor) const {
    const auto num_fronts = static_cast<int>(begin_.size()) - 1;
    factor->front_begin = begin_;
    factor->row_begin.assign(1, 0);
    for (int f = 0; f < num_fronts; ++f) {
      factor->row_begin.push_back(factor->row_begin.back() + RowsOf(begin_[f], begin_[f + 1]));
    }
    factor->rows.resize(factor->row_begin.back());
    std::vector<int> next(factor->row_begin.begin(), factor->row_begin.end() - 1), front_of(size());
    for (int f = 0; f < num_fronts; ++f) {
      std::fill(front_of.begin() + begin_[f], front_of.begin() + begin_[f + 1], f);
    }
    // Row by row, again along the paths of the tree: every front that the row crosses lists it
    // once.
    std::vector<int> last_row(num_fronts, -1);
    for (int row = 0; row < size(); ++row) {
      const auto list = [&](int f) {
        last_row[f] = row;
        factor->rows[next[f]++] = row;
      };
      list(front_of[row]);
      // The parent of a front is that of its last column.
      for (int k = neighbors_begin_[row]; k < neighbors_begin_[row + 1]; ++k) {
        for (int f = front_of[neighbors_[k]]; last_row[f] != row;
             f = front_of[parents_[begin_[f + 1] - 1]]) {
          list(f);
        }
      }
    }
  }

  const BlockPattern& pattern_;
  std::vector<int> order_;            // block by position
  std::vector<int> neighbors_begin_;  // per position, and one more
  std::vector<int> neighbors_;        // positions before it
  // per position: of the first entry below the diagonal; -1: there is none
  std::vector<int> parents_;
  std::vector<int> counts_;  // per position: entries of the column, the diagonal included
  std::vector<int> begin_;   // of fronts, and one more
};

}  // namespace

// AMD's order is always made: it is the fallback, and tells whether the factor is dear enough for
// METIS to be asked. Slightly more flops are taken for parts, since these are factored side by
// side.
Status FindSymbolicFactor(const BlockPattern& pattern, bool may_dissect, SymbolicFactor* factor) {
  *factor = SymbolicFactor();
  std::vector<int> order;
  if (!OrderRows(pattern, &order)) {
    return Status::Error(StatusCode::kUnavailable,
                         "AMD could not order the reduced system (out of memory?)");
  }
  EliminationTree tree(pattern, order);
  const int num_blocks = pattern.num_blocks();
  const double flops = tree.Flops();
  const auto take_parts = [&](int smallest_cut) {
    if (!pattern.groups.empty() || !OrderByParts(pattern, smallest_cut, &order)) {
      return false;
    }
    EliminationTree parts(pattern, order);
    factor->dissected = parts.Flops() < kWorthOfHalves * flops;
    if (factor->dissected) {
      parts.FindFronts(factor);
    }
    return factor->dissected;
  };
  const auto num_entries = static_cast<double>(pattern.columns.size());
  const bool is_dear = flops >= kFlopsPerBlockForParts * num_entries;
  const bool takes_parts =
      (is_dear && num_blocks > kSmallestCut && take_parts(kSmallestCut)) ||
      (may_dissect && flops >= kMinFlopsForDissection && take_parts(num_blocks - 1));
  if (!takes_parts) {
    tree.FindFronts(factor);
  }
  return Status::Ok();
}

void FindFronts(const BlockPattern& pattern, const std::vector<int>& order,
                SymbolicFactor* factor) {
  *factor = SymbolicFactor();
  EliminationTree(pattern, order).FindFronts(factor);
}

}  // namespace inceres::internal
