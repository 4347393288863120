#include "problem/graph_restorer.h"

#include <algorithm>
#include <string>
#include <utility>

#include "problem/edited_graph.h"
#include "problem/find_fault.h"

// Makes a graph of parts that were read from a file, and trusts none of them: sizes, ids and counts
// may be anything. Each step checks what it is given before it indexes by it, builds in a graph of
// its own, and leaves meaning to FactorGraph::Validate, as for a graph that a program builds. The
// target is replaced at the end, so an error leaves it as it was. Free ids and places are restored
// in their order, so that later edits give out the same ids as in the graph that was written.

namespace inceres::internal {
namespace {

Status RestoreVariables(const GraphParts& parts, VariableTable* variables) {
  // Variables lie in the state in the order of their ids.
  std::size_t offset = 0;
  for (const VariableRecord& given : parts.variables) {
    const std::string name = VariableName(variables->size());
    if (given.ambient_size <= 0) {
      // Before the state is split by these sizes.
      return Invalid(name + " has no values");
    }
    if (given.manifold != nullptr && given.manifold->AmbientSize() != given.ambient_size) {
      return Invalid(name + " is of another size than its manifold");
    }
    if (parts.state.size() - offset < IndexOf(given.ambient_size)) {
      return Invalid(name + " ends behind the end of the state, which has " +
                     std::to_string(parts.state.size()) + " values");
    }
    VariableRecord record = VariableRecord::Owned(given.ambient_size, given.role, given.manifold);
    record.constant = given.constant;
    const VariableId id = variables->Append(std::move(record), parts.state.data() + offset);
    // A removed variable keeps its size, for the room it leaves, and nothing else.
    if (given.removed) {
      variables->Remove(id);
    }
    offset += IndexOf(given.ambient_size);
  }
  return offset == parts.state.size()
             ? Status::Ok()
             : Invalid("the variables have " + std::to_string(offset) + " values, the state " +
                       std::to_string(parts.state.size()));
}

// Removed variables and free ids are the same set: each once, and all of them.
Status RestoreFree(const std::vector<VariableId>& free, VariableTable* variables) {
  std::vector<char> seen(IndexOf(variables->size()), 0);
  for (const VariableId id : free) {
    if (id < 0 || id >= variables->size() || variables->Has(id) || seen[IndexOf(id)] != 0) {
      return Invalid(VariableName(id) + " is no removed one, or is free twice");
    }
    seen[IndexOf(id)] = 1;
    variables->Free(id);
  }
  // Each is removed and listed once, so equal numbers mean equal sets.
  return static_cast<int>(free.size()) == variables->num_removed()
             ? Status::Ok()
             : Invalid("not every removed variable is free");
}

Status RestoreSettings(GraphParts* parts, VariableTable* variables) {
  // Whatever is attached to a variable must be of its size, or reading it would go beyond its end.
  const auto fits = [variables](VariableId id, std::size_t size) {
    return variables->Has(id) && size == IndexOf((*variables)[id].ambient_size);
  };
  for (const auto& [id, bounds] : parts->bounds) {
    if (!fits(id, bounds.lower.size()) || !fits(id, bounds.upper.size())) {
      return Invalid("bounds of " + VariableName(id) + " are of another size, or it is not there");
    }
  }
  for (const auto& [id, values] : parts->pins) {
    if (!fits(id, values.size()) || !AllFinite(values.data(), values.size())) {
      return Invalid("the pinned values of " + VariableName(id) +
                     " are of another size or not finite, or it is not there");
    }
  }
  for (const auto& [id, group] : parts->groups) {
    if (!variables->Has(id)) {
      return Invalid(VariableName(id) + " is in an elimination group, and is not there");
    }
    variables->SetGroup(id, group);
  }
  // Taken over after all have been looked at.
  variables->TakeBounds(&parts->bounds);
  variables->TakePins(&parts->pins);
  return Status::Ok();
}

// Places start as taken; those that are listed are freed one by one, and a second time is an error.
Status FreePlaces(const std::string& name, FamilyRecord* record) {
  const auto num_slots = static_cast<std::size_t>(record->family->num_slots());
  const auto num_places = static_cast<std::size_t>(record->num_factors);
  if (!record->free_places.empty()) {
    record->places.assign(num_places, PlaceState::kIncremental);
    record->generations.assign(num_places, 0);
  }
  for (const std::int32_t place : record->free_places) {
    if (place < 0 || IndexOf(place) >= num_places ||
        record->places[IndexOf(place)] == PlaceState::kFree) {
      return Invalid(name + ": place " + std::to_string(place) +
                     " does not exist, or is free twice");
    }
    record->places[IndexOf(place)] = PlaceState::kFree;
    // As after one removal.
    record->generations[IndexOf(place)] = 1;
    // As a removed factor leaves them.
    std::fill_n(record->variables.begin() +
                    static_cast<std::ptrdiff_t>(place) * static_cast<std::ptrdiff_t>(num_slots),
                num_slots, -1);
    if (!record->losses.empty()) {
      record->losses[IndexOf(place)] = nullptr;
    }
  }
  return Status::Ok();
}

}  // namespace

// The family by value: what has passed is moved into the graph.
Status GraphRestorer::RestoreFamily(FamilyRecord record, FactorGraph* graph) {
  if (record.family == nullptr) {
    return Invalid("family " + std::to_string(graph->num_families()) + " is missing");
  }
  const FactorFamily& family = *record.family;
  const std::string name = FamilyName(graph->num_families(), family);
  const auto num_slots = static_cast<std::size_t>(family.num_slots());
  const auto num_places = static_cast<std::size_t>(record.num_factors);
  // Sizes of arrays first; the ids in them are for Validate.
  if (record.num_factors < 0 || record.num_factors > family.size() ||
      record.variables.size() != num_places * num_slots ||
      (!record.losses.empty() && record.losses.size() != num_places)) {
    return Invalid(name + " has other factors than measurements, variables or losses");
  }
  const Status freed = FreePlaces(name, &record);
  if (!freed.ok()) {
    return freed;
  }
  // More measurements than places, or anything free: only an edit leads there, and Validate allows
  // it only then.
  graph->is_edited_ = graph->is_edited_ || !record.free_places.empty() ||
                      static_cast<int>(num_places) < family.size();
  graph->factors_.Restore(std::move(record));
  return Status::Ok();
}

Status GraphRestorer::Restore(GraphParts parts, FactorGraph* graph) {
  // A fresh graph; the first error ends it, and it is thrown away.
  FactorGraph restored;
  VariableTable* variables = &restored.variables_;
  Status status = RestoreVariables(parts, variables);
  status = status.ok() ? RestoreFree(parts.free_variables, variables) : status;
  status = status.ok() ? RestoreSettings(&parts, variables) : status;
  for (FamilyRecord& family : parts.families) {
    status = status.ok() ? RestoreFamily(std::move(family), &restored) : status;
  }
  // An edit is what removes variables.
  restored.is_edited_ = restored.is_edited_ || variables->num_removed() > 0;
  status = status.ok() ? restored.Validate() : status;
  if (status.ok()) {
    // Edits that were begun on the graph as it was are refused from now on, for an assignment
    // changes the revision.
    *graph = std::move(restored);
  }
  return status;
}

}  // namespace inceres::internal
