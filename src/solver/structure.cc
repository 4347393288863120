#include "solver/structure.h"

namespace inceres::internal {
namespace {

// visit(number) for each number of the structure, in a fixed order, until it returns false. Every list is preceded by its length,
// so that equal sequences mean equal structures.
template <typename Visit>
bool ForEachNumber(const FactorGraph& graph, const Visit& visit) {
  if (!visit(graph.num_variables()) || !visit(graph.num_families())) {
    return false;
  }
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    const bool landmark = graph.role(id) == Role::kLandmark;
    const bool curved = graph.manifold(id) != nullptr;
    const int flags = (landmark ? 1 : 0) + (graph.IsConstant(id) ? 2 : 0) + (curved ? 4 : 0);
    const std::int64_t offset = graph.StateOffset(id);
    if (!visit(flags) || !visit(graph.AmbientSize(id)) || !visit(graph.TangentSize(id)) ||
        !visit(static_cast<std::int32_t>(offset)) || !visit(static_cast<std::int32_t>(offset >> 32))) {
      return false;
    }
  }
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const FactorFamily& family = graph.family(id);
    if (!visit(graph.NumFactors(id)) || !visit(family.residual_size()) || !visit(family.num_slots())) {
      return false;
    }
    for (int s = 0; s < family.num_slots(); ++s) {
      if (!visit(family.slot(s).ambient_size) || !visit(family.slot(s).tangent_size)) {
        return false;
      }
    }
    const std::int64_t num_entries = static_cast<std::int64_t>(graph.NumFactors(id)) * family.num_slots();
    const VariableId* variables = num_entries > 0 ? graph.Variables(id, 0) : nullptr;
    for (std::int64_t k = 0; k < num_entries; ++k) {
      if (!visit(variables[k])) {
        return false;
      }
    }
  }
  return true;
}

}  // namespace

Structure::Structure(const FactorGraph& graph) {
  std::size_t count = 0;
  ForEachNumber(graph, [&count](std::int32_t /*number*/) {
    ++count;
    return true;
  });
  numbers_.reserve(count);  // taken when a solve has all its memory: no more than needed, then
  ForEachNumber(graph, [this](std::int32_t number) {
    numbers_.push_back(number);
    return true;
  });
}

bool Structure::IsThatOf(const FactorGraph& graph) const {
  const std::int32_t* next = numbers_.data();
  const std::int32_t* const end = next + numbers_.size();
  return ForEachNumber(graph, [&](std::int32_t number) { return next != end && *next++ == number; }) && next == end;
}

}  // namespace inceres::internal
