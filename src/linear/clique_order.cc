#include "linear/clique_order.h"

#include <camd.h>

#include <algorithm>
#include <cstddef>
#include <numeric>

#include "linear/group_order.h"

namespace inceres::internal {

// The order in which the Bayes tree eliminates rows that an edit has loosened (docs/algorithms.md,
// "Reduced linear systems", Bayes tree). Constrained AMD sees a graph of the loose rows and of one
// node for each subtree that stays: a subtree is a variable that is eliminated first, and its edges
// go to the rows of its separator. Its fill, a clique of the separator, so takes part in the
// degrees, as it does in the factor. Rows that are to come last are a third class of constraint.
//
// The fronts are then found for the pattern of the loose rows alone, in which each subtree has left
// the edges that ForEachStarEdge lists.

namespace {

bool IsSet(char flag) {
  return flag != 0;
}

// Per variable what it is ordered by before fill counts: its group, and within it whether it comes
// last. As 0, 1, …: where no row, or every row, is to come last there is no second class.
void ListClasses(const EliminationGraph& graph, std::vector<int>* classes) {
  const bool all_last = std::all_of(graph.last.begin(), graph.last.end(), IsSet);
  classes->assign(graph.last.size(), 0);
  for (std::size_t i = 0; i < classes->size() && !all_last; ++i) {
    (*classes)[i] = IsSet(graph.last[i]) ? 1 : 0;
  }
  if (graph.groups.empty()) {
    return;
  }
  const std::vector<int> ranks = RanksOf(graph.groups);
  for (std::size_t i = 0; i < classes->size(); ++i) {
    (*classes)[i] += 2 * ranks[i];
  }
  *classes = RanksOf(*classes);
}

}  // namespace

void EliminationGraph::Clear() {
  sizes.clear();
  edge_begin.assign(1, 0);
  edges.clear();
  separator_begin.assign(1, 0);
  members.clear();
  last.clear();
  groups.clear();
}

Status CliqueOrder::Find(const EliminationGraph& graph, SymbolicFactor* factor) {
  if (!OrderByCamd(graph)) {
    return Status::Error(StatusCode::kUnavailable,
                         "CAMD could not order the reduced system (out of memory?)");
  }
  ListPattern(graph);
  FindFronts(pattern_, order_, factor);
  return Status::Ok();
}

// Variables first, then subtrees, whose constraint is the lowest.
bool CliqueOrder::OrderByCamd(const EliminationGraph& graph) {
  const int n = graph.num_variables();
  const int num_nodes = n + graph.num_subtrees();
  columns_begin_.assign(graph.edge_begin.begin(), graph.edge_begin.end());
  // CAMD reads the columns of either triangle: each edge is listed once, at one of its ends.
  columns_.assign(graph.edges.begin(), graph.edges.end());
  columns_.reserve(1);  // CAMD takes no null
  columns_.insert(columns_.end(), graph.members.begin(), graph.members.end());
  for (int k = 1; k <= graph.num_subtrees(); ++k) {
    columns_begin_.push_back(graph.edge_begin.back() + graph.separator_begin[k]);
  }
  // CAMD eliminates classes by ascending number, and within a class as it likes. The numbers have
  // to stay below that of the nodes, so a class without members gets none: without subtrees the
  // variables begin with 0.
  //
  // That subtrees come before variables of lower groups than theirs is in order: whatever was above
  // one of them is of its group or a higher one, and only such rows come to be above it again.
  ListClasses(graph, &constraints_);
  const int lowest = num_nodes > n ? 1 : 0;  // of a variable
  std::for_each(constraints_.begin(), constraints_.end(), [lowest](int& c) { c += lowest; });
  constraints_.resize(num_nodes, 0);
  // Its memory serves as a workspace of ListPattern later on.
  permutation_.resize(num_nodes);
  const int result = camd_order(num_nodes, columns_begin_.data(), columns_.data(),
                                permutation_.data(), nullptr, nullptr, constraints_.data());
  order_.clear();
  // The subtrees come first in the permutation. They have their order already and drop out.
  std::copy_if(permutation_.begin(), permutation_.end(), std::back_inserter(order_),
               [n](int node) { return node < n; });
  return result >= CAMD_OK;
}

// What a subtree couples is what it leaves to the first variable of its separator: the others are
// among the rows of that one's column, and so of all that follow.
// All edges of the clique would have the same factor and be quadratic in the separator.
template <typename Visit>
void CliqueOrder::ForEachStarEdge(const EliminationGraph& graph, const Visit& visit) const {
  for (int k = 0; k < graph.num_subtrees(); ++k) {
    const auto begin = graph.members.begin() + graph.separator_begin[k];
    const auto end = graph.members.begin() + graph.separator_begin[k + 1];
    const int first =
        *std::min_element(begin, end, [this](int a, int b) { return position_[a] < position_[b]; });
    std::for_each(begin, end, [&](int member) {
      if (member != first) {
        visit(std::max(first, member), std::min(first, member));
      }
    });
  }
}

// Counted first, then placed. A row's blocks may come twice, once from S and once from a subtree,
// and in any order; only the diagonal block has to be last (FindFronts).
void CliqueOrder::ListPattern(const EliminationGraph& graph) {
  const int n = graph.num_variables();
  position_.resize(n);
  for (int at = 0; at < n; ++at) {
    position_[order_[at]] = at;
  }
  std::vector<int>& begin = pattern_.row_begin;
  begin.assign(n + 1, 0);
  for (int i = 0; i < n; ++i) {
    begin[i + 1] = graph.edge_begin[i + 1] - graph.edge_begin[i] + 1;
  }
  ForEachStarEdge(graph, [&begin](int row, int) { ++begin[row + 1]; });
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  pattern_.columns.resize(begin.back());
  // Only the structure and the sizes are needed; there are no values.
  pattern_.offsets.assign(1, 0);
  std::vector<int>& next = permutation_;  // its work is done
  next.assign(begin.begin(), begin.end() - 1);
  for (int i = 0; i < n; ++i) {
    pattern_.offsets.push_back(pattern_.offsets.back() + graph.sizes[i]);
    pattern_.columns[begin[i + 1] - 1] = i;
    for (int k = graph.edge_begin[i]; k < graph.edge_begin[i + 1]; ++k) {
      pattern_.columns[next[i]++] = graph.edges[k];
    }
  }
  ForEachStarEdge(graph, [&](int row, int column) { pattern_.columns[next[row]++] = column; });
}

}  // namespace inceres::internal
