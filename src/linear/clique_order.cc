#include "linear/clique_order.h"

#include <camd.h>

#include <algorithm>
#include <numeric>

namespace inceres::internal {
namespace {

bool IsSet(char flag) {
  return flag != 0;
}

}  // namespace

void EliminationGraph::Clear() {
  sizes.clear();
  edge_begin.assign(1, 0);
  edges.clear();
  separator_begin.assign(1, 0);
  members.clear();
  last.clear();
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
  columns_.assign(graph.edges.begin(), graph.edges.end());
  columns_.reserve(1);  // CAMD takes no null
  columns_.insert(columns_.end(), graph.members.begin(), graph.members.end());
  for (int k = 1; k <= graph.num_subtrees(); ++k) {
    columns_begin_.push_back(graph.edge_begin.back() + graph.separator_begin[k]);
  }
  constraints_.assign(num_nodes, 0);
  const int lowest = num_nodes > n ? 1 : 0;  // of a variable
  const bool all_last = std::all_of(graph.last.begin(), graph.last.end(), IsSet);
  for (int i = 0; i < n; ++i) {
    constraints_[i] = lowest + (!all_last && IsSet(graph.last[i]) ? 1 : 0);
  }
  permutation_.resize(num_nodes);
  const int result = camd_order(num_nodes, columns_begin_.data(), columns_.data(),
                                permutation_.data(), nullptr, nullptr, constraints_.data());
  order_.clear();
  std::copy_if(permutation_.begin(), permutation_.end(), std::back_inserter(order_),
               [n](int node) { return node < n; });
  return result >= CAMD_OK;
}

// What a subtree couples is what it leaves to the first variable of its separator: the others are
// among the rows of that one's column, and so of all that follow.
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
