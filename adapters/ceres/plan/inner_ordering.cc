#include "adapters/ceres/plan/inner_ordering.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <set>

#include <glog/logging.h>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/ordering.h"

namespace inceres::internal {
namespace {

// Blocks that share a residual block, as Ceres's Hessian graph.
class BlockGraph {
 public:
  explicit BlockGraph(const ProblemView& view) : neighbors_(view.blocks.size()) {
    std::vector<char> seen(view.blocks.size(), 0);
    for (const ResidualBlockView& residual : view.residuals) {
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
      std::sort(list.begin(), list.end());
      list.erase(std::unique(list.begin(), list.end()), list.end());
    }
  }

  const std::vector<int>& order() const { return order_; }  // of first appearance
  const std::vector<int>& Neighbors(int b) const { return neighbors_[At(b)]; }

 private:
  std::vector<int> order_;
  std::vector<std::vector<int>> neighbors_;
};

// Takes blocks in the order of their number of neighbors, each unless a neighbor has been taken;
// then the same with what is left.
std::vector<std::vector<int>> RecursiveIndependentSets(const ProblemView& view) {
  const BlockGraph graph(view);
  std::vector<int> left = graph.order();
  std::vector<int> degree(view.blocks.size(), 0);
  for (const int b : left) {
    degree[At(b)] = static_cast<int>(graph.Neighbors(b).size());
  }
  std::vector<std::vector<int>> sets;
  std::vector<std::size_t> met(view.blocks.size(), 0);  // the last set one of its neighbors is in
  while (!left.empty()) {
    std::vector<int> sorted = left;
    std::stable_sort(sorted.begin(), sorted.end(),
                     [&](int a, int b) { return degree[At(a)] < degree[At(b)]; });
    std::vector<int>& set = sets.emplace_back();
    std::vector<char> taken(view.blocks.size(), 0);
    for (const int b : sorted) {
      if (met[At(b)] == sets.size()) {
        continue;
      }
      set.push_back(b);
      taken[At(b)] = 1;
      for (const int neighbor : graph.Neighbors(b)) {
        met[At(neighbor)] = sets.size();
        --degree[At(neighbor)];
      }
    }
    left.erase(std::remove_if(left.begin(), left.end(), [&](int b) { return taken[At(b)] != 0; }),
               left.end());
  }
  std::reverse(sets.begin(), sets.end());
  return sets;
}

bool SharesNoResidual(const ProblemView& view, const std::vector<int>& group) {
  std::vector<char> in_group(view.blocks.size(), 0);
  for (const int b : group) {
    in_group[At(b)] = 1;
  }
  return std::all_of(view.residuals.begin(), view.residuals.end(),
                     [&](const ResidualBlockView& residual) {
                       const int* slots = view.SlotsOf(residual);
                       return std::count_if(slots, slots + residual.num_slots,
                                            [&](int b) { return in_group[At(b)] != 0; }) <= 1;
                     });
}

// Why a group of the caller's cannot be one, or an empty string.
std::string FaultOfGroup(const ProblemView& view, const std::set<double*>& elements,
                         const std::vector<int>& group) {
  if (std::any_of(elements.begin(), elements.end(),
                  [&](const double* element) { return view.index.Find(element) < 0; })) {
    return "inner_iteration_ordering contains an address that is no parameter block of the "
           "problem.";
  }
  return SharesNoResidual(view, group)
             ? ""
             : "The user-provided parameter_blocks_for_inner_iterations does not form an "
               "independent set.";
}

// What the caller gave, less what does not move.
void ReadGroups(const ceres::ParameterBlockOrdering& given, const ProblemView& view,
                InnerOrdering* ordering) {
  for (const auto& [id, elements] : given.group_to_elements()) {
    std::vector<int> group;
    for (const double* element : elements) {
      const int b = view.index.Find(element);
      if (b >= 0 && view.IsReduced(b)) {
        group.push_back(b);
      }
    }
    const std::string fault = FaultOfGroup(view, elements, group);
    if (ordering->error.empty() && !fault.empty()) {
      ordering->error = fault + " Group Id: " + std::to_string(id);
    }
    if (!group.empty()) {
      ordering->groups.push_back(std::move(group));
    }
  }
  LOG_IF(WARNING, ordering->groups.empty() && ordering->error.empty())
      << "No remaining elements in the inner iteration ordering.";
}

}  // namespace

InnerOrdering FindInnerOrdering(const ceres::Solver::Options& options,
                                const ceres::EvaluationCallback* evaluation_callback,
                                const ProblemView& view) {
  InnerOrdering ordering;
  if (evaluation_callback != nullptr) {
    ordering.error = "Inner iterations cannot be used with EvaluationCallbacks";
    return ordering;
  }
  if (view.reduced.num_parameter_blocks == 1) {
    LOG(WARNING) << "Reduced problem only contains one parameter block."
                 << "Disabling inner iterations.";
    ordering.group_sizes = GroupSizes(options.inner_iteration_ordering.get());
    return ordering;
  }
  if (options.inner_iteration_ordering != nullptr) {
    ReadGroups(*options.inner_iteration_ordering, view, &ordering);
  } else {
    ordering.groups = RecursiveIndependentSets(view);
  }
  for (const std::vector<int>& group : ordering.groups) {
    ordering.group_sizes.push_back(static_cast<int>(group.size()));
  }
  return ordering;
}

std::vector<std::vector<VariableId>> GroupsInGraph(const InnerOrdering& ordering,
                                                   const GraphPlan& plan, std::size_t num_blocks) {
  std::vector<VariableId> variables(num_blocks, -1);
  for (std::size_t id = 0; id < plan.blocks.size(); ++id) {
    variables[At(plan.blocks[id])] = static_cast<VariableId>(id);
  }
  std::vector<std::vector<VariableId>> groups;
  for (const std::vector<int>& group : ordering.groups) {
    std::vector<VariableId>& ids = groups.emplace_back();
    std::transform(group.begin(), group.end(), std::back_inserter(ids),
                   [&](int b) { return variables[At(b)]; });
  }
  return groups;
}

}  // namespace inceres::internal
