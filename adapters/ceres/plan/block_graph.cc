#include "adapters/ceres/plan/block_graph.h"

#include <algorithm>

#include "adapters/ceres/read/index.h"
#include "src/base/sort_unique.h"

namespace inceres::internal {

BlockGraph::BlockGraph(const ProblemView& view) : neighbors_(view.blocks.size()) {
  std::vector<char> seen(view.blocks.size(), 0);
  for (const int r : view.moving) {
    const ResidualBlockView& residual = view.residuals[At(r)];
    const int* slots = view.SlotsOf(residual);
    for (int s = 0; s < residual.num_slots; ++s) {
      if (!view.IsReduced(slots[s])) {
        continue;
      }
      if (seen[At(slots[s])] == 0) {
        seen[At(slots[s])] = 1;
        order_.push_back(slots[s]);
      }
      for (int t = 0; t < residual.num_slots; ++t) {
        if (t != s && view.IsReduced(slots[t])) {
          neighbors_[At(slots[s])].push_back(slots[t]);
        }
      }
    }
  }
  for (const int b : order_) {
    std::vector<int>& list = neighbors_[At(b)];
    SortUnique(&list);
  }
}

IndependentSets::IndependentSets(const BlockGraph& graph)
    : graph_(graph),
      left_(graph.order()),
      degree_(graph.num_blocks(), 0),
      met_(graph.num_blocks(), 0) {
  for (const int b : left_) {
    degree_[At(b)] = static_cast<int>(graph.Neighbors(b).size());
  }
}

std::vector<int> IndependentSets::TakeOne() {
  ++num_sets_;
  std::vector<int> sorted = left_;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](int a, int b) { return degree_[At(a)] < degree_[At(b)]; });
  std::vector<int> set;
  std::vector<char> taken(graph_.num_blocks(), 0);
  for (const int b : sorted) {
    if (met_[At(b)] == num_sets_) {
      continue;
    }
    set.push_back(b);
    taken[At(b)] = 1;
    for (const int neighbor : graph_.Neighbors(b)) {
      met_[At(neighbor)] = num_sets_;
      --degree_[At(neighbor)];
    }
  }
  left_.erase(std::remove_if(left_.begin(), left_.end(), [&](int b) { return taken[At(b)] != 0; }),
              left_.end());
  return set;
}

}  // namespace inceres::internal
