#include "trust_region/structure.h"

#include <algorithm>

namespace inceres::internal {
namespace {

// The structure of a graph as one list of numbers, walked by one function for all three uses:
// counting, collecting and comparing cannot disagree about what belongs to it. Comparing stops at
// the first difference, so a graph that is another is told apart at once mostly.

// visit(number), or visit(first, count) for many, for each number of the structure, in a fixed
// order, until it returns false. Every list is preceded by its length, so that equal sequences mean
// equal structures.
template <typename Visit>
bool ForEachNumber(const FactorGraph& graph, Visit&& visit) {
  if (!visit(graph.num_variables()) || !visit(graph.num_families())) {
    return false;
  }
  // The order of elimination is part of the plans.
  const bool grouped = graph.HasEliminationGroups();
  if (!visit(grouped ? 1 : 0)) {
    return false;
  }
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    const bool landmark = graph.role(id) == Role::kLandmark;
    const bool curved = graph.manifold(id) != nullptr;
    // A manifold counts by being there: which variables have a map to compute.
    const int flags = (landmark ? 1 : 0) + (graph.IsConstant(id) ? 2 : 0) + (curved ? 4 : 0);
    // 64 bits in two halves: where a variable's values lie decides where parameters point.
    const std::int64_t offset = graph.StateOffset(id);
    if (!visit(flags) || !visit(graph.AmbientSize(id)) || !visit(graph.TangentSize(id)) ||
        !visit(static_cast<std::int32_t>(offset)) ||
        !visit(static_cast<std::int32_t>(offset >> 32)) ||
        (grouped && !visit(graph.elimination_group(id)))) {
      return false;
    }
  }
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const FactorFamily& family = graph.family(id);
    // What a family is called for beside passes over its factors decides whether it has tables of
    // parameters, and in which precision Jacobians are kept.
    const int calls = (family.Prepares() ? 1 : 0) + (family.Recenters() ? 2 : 0);
    // Sizes before the list of variables: its length follows from them.
    if (!visit(calls) || !visit(graph.NumFactors(id)) || !visit(family.residual_size()) ||
        !visit(family.num_slots())) {
      return false;
    }
    for (int s = 0; s < family.num_slots(); ++s) {
      if (!visit(family.slot(s).ambient_size) || !visit(family.slot(s).tangent_size)) {
        return false;
      }
    }
    const std::int64_t num_entries =
        static_cast<std::int64_t>(graph.NumFactors(id)) * family.num_slots();
    // Free places are in the list as -1.
    if (num_entries > 0 && !visit(graph.Variables(id, 0), num_entries)) {
      return false;
    }
  }
  return true;
}

// The list is as long as counted, for it stays while the solver does.
struct Counter {
  bool operator()(std::int32_t /*number*/) {
    ++count;
    return true;
  }
  bool operator()(const std::int32_t* /*first*/, std::int64_t num_numbers) {
    count += num_numbers;
    return true;
  }
  std::int64_t count = 0;
};

// Writes what the counter has counted.
struct Collector {
  bool operator()(std::int32_t number) {
    numbers.push_back(number);
    return true;
  }
  bool operator()(const std::int32_t* first, std::int64_t count) {
    numbers.insert(numbers.end(), first, first + count);
    return true;
  }
  std::vector<std::int32_t>& numbers;
};

// Goes along a list.
struct Comparer {
  // Also false where the list ends too early.
  bool operator()(std::int32_t number) { return next != end && *next++ == number; }
  bool operator()(const std::int32_t* first, std::int64_t count) {
    const std::int32_t* const begin = next;
    next += std::min<std::int64_t>(count, end - begin);
    return std::equal(begin, next, first, first + count);
  }
  const std::int32_t* next;
  const std::int32_t* end;
};

}  // namespace

Structure::Structure(const FactorGraph& graph) {
  Counter counter;
  ForEachNumber(graph, counter);
  numbers_.reserve(static_cast<std::size_t>(
      counter.count));  // taken when a solve has all its memory: no more than needed, then
  ForEachNumber(graph, Collector{numbers_});
}

bool Structure::IsThatOf(const FactorGraph& graph) const {
  // The list must end with the graph: a longer one is another structure.
  Comparer comparer{numbers_.data(), numbers_.data() + numbers_.size()};
  return ForEachNumber(graph, comparer) && comparer.next == comparer.end;
}

}  // namespace inceres::internal
