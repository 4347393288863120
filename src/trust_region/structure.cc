#include "trust_region/structure.h"

#include <algorithm>
#include <initializer_list>

namespace inceres::internal {
namespace {

// The structure of a graph as one list of numbers, walked by one function for all three uses:
// counting, collecting and comparing cannot disagree about what belongs to it. Comparing stops at
// the first difference, so a graph that is another is told apart at once mostly.

// visit(first, count) for all numbers of the structure, a few or many at a time, in a fixed order,
// until it returns false. Every list is preceded by its length, so that equal sequences mean equal
// structures.
template <typename Visit>
bool ForEachNumber(const FactorGraph& graph, const Visit& visit) {
  const auto few = [&](std::initializer_list<std::int32_t> numbers) {
    return visit(numbers.begin(), static_cast<std::int64_t>(numbers.size()));
  };
  // The order of elimination is part of the plans.
  const bool grouped = graph.HasEliminationGroups();
  bool go_on = few({graph.num_variables(), graph.num_families(), grouped ? 1 : 0});
  for (VariableId id = 0; go_on && id < graph.num_variables(); ++id) {
    const bool landmark = graph.role(id) == Role::kLandmark;
    const bool curved = graph.manifold(id) != nullptr;
    // A manifold counts by being there: which variables have a map to compute.
    const int flags = (landmark ? 1 : 0) + (graph.IsConstant(id) ? 2 : 0) + (curved ? 4 : 0);
    // 64 bits in two halves: where a variable's values lie decides where parameters point.
    const std::int64_t offset = graph.StateOffset(id);
    go_on = few({flags, graph.AmbientSize(id), graph.TangentSize(id),
                 static_cast<std::int32_t>(offset), static_cast<std::int32_t>(offset >> 32)}) &&
            (!grouped || few({graph.elimination_group(id)}));
  }
  for (FamilyId id = 0; go_on && id < graph.num_families(); ++id) {
    const FactorFamily& family = graph.family(id);
    // What a family is called for beside passes over its factors decides whether it has tables of
    // parameters, and in which precision Jacobians are kept.
    const int calls = (family.Prepares() ? 1 : 0) + (family.Recenters() ? 2 : 0);
    // Sizes before the list of variables: its length follows from them.
    go_on = few({calls, graph.NumFactors(id), family.residual_size(), family.num_slots()});
    for (int s = 0; go_on && s < family.num_slots(); ++s) {
      go_on = few({family.slot(s).ambient_size, family.slot(s).tangent_size});
    }
    const std::int64_t num_entries =
        static_cast<std::int64_t>(graph.NumFactors(id)) * family.num_slots();
    // Free places are in the list as -1.
    go_on = go_on && (num_entries == 0 || visit(graph.Variables(id, 0), num_entries));
  }
  return go_on;
}

}  // namespace

Structure::Structure(const FactorGraph& graph) {
  std::int64_t num_numbers = 0;
  ForEachNumber(graph, [&](const std::int32_t* /*first*/, std::int64_t count) {
    num_numbers += count;
    return true;
  });
  // It stays while the solver does, and is taken when a solve has all its memory: no more than
  // needed, then.
  numbers_.reserve(static_cast<std::size_t>(num_numbers));
  ForEachNumber(graph, [&](const std::int32_t* first, std::int64_t count) {
    numbers_.insert(numbers_.end(), first, first + count);
    return true;
  });
}

bool Structure::IsThatOf(const FactorGraph& graph) const {
  const std::int32_t* next = numbers_.data();
  const std::int32_t* const end = next + numbers_.size();
  const auto agrees = [&](const std::int32_t* first, std::int64_t count) {
    if (end - next < count || !std::equal(first, first + count, next)) {
      return false;
    }
    next += count;
    return true;
  };
  // The list must end with the graph: a longer one is another structure.
  return ForEachNumber(graph, agrees) && next == end;
}

}  // namespace inceres::internal
