#include "adapters/ceres/plan/inner_ordering.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <set>

#include <glog/logging.h>

#include "adapters/ceres/plan/block_graph.h"
#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/ordering.h"

namespace inceres::internal {
namespace {

// Independent sets of what is left, one after the other, the last one first.
std::vector<std::vector<int>> RecursiveIndependentSets(const ProblemView& view) {
  const BlockGraph graph(view);
  IndependentSets left(graph);
  std::vector<std::vector<int>> sets;
  while (!left.empty()) {
    sets.push_back(left.TakeOne());
  }
  std::reverse(sets.begin(), sets.end());
  return sets;
}

// Why a group of the caller's cannot be one, or an empty string.
std::string FaultOfGroup(const ProblemView& view, const std::set<double*>& elements,
                         const std::vector<int>& group) {
  if (std::any_of(elements.begin(), elements.end(),
                  [&](const double* element) { return view.index.Find(element) < 0; })) {
    return "inner_iteration_ordering contains an address that is no parameter block of the "
           "problem.";
  }
  return IsIndependentSet(view, group)
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
    ordering.group_sizes = GroupSizes(options.inner_iteration_ordering.get());
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
