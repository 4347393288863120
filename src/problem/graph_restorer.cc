#include "problem/graph_restorer.h"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "problem/edit_state.h"
#include "problem/find_fault.h"

// Makes a graph of parts that were read from a file, and trusts none of them: sizes, ids and counts
// may be anything. Each step checks what it is given before it indexes by it, builds in a graph of
// its own, and leaves meaning to FactorGraph::Validate, as for a graph that a program builds. The
// target is replaced at the end, so an error leaves it as it was. Free ids and places are restored
// in their order, so that later edits give out the same ids as in the graph that was written.

namespace inceres::internal {

Status GraphRestorer::RestoreVariables(const GraphParts& parts, FactorGraph* graph) {
  // Offsets follow from the sizes: variables lie in the state in the order of their ids.
  std::int64_t offset = 0;
  for (const GraphParts::Variable& given : parts.variables) {
    const std::string name = VariableName(graph->num_variables());
    if (given.ambient_size <= 0) {
      // Before the state is split by these sizes.
      return Invalid(name + " has no values");
    }
    if (given.manifold != nullptr && given.manifold->AmbientSize() != given.ambient_size) {
      return Invalid(name + " is of another size than its manifold");
    }
    VariableRecord record = MakeOwned(given.ambient_size, given.role, given.manifold);
    record.constant = given.constant;
    record.offset = offset;
    // A removed variable keeps its size, for the room it leaves, and nothing else.
    if (given.removed) {  // as EditCommit leaves it
      record.manifold = nullptr;
      record.tangent_size = 0;
      record.role = Role::kFrame;
      record.constant = record.removed = true;
      ++graph->num_removed_variables_;
    }
    graph->variables_.push_back(std::move(record));
    offset += given.ambient_size;
  }
  // Too few values or too many: then offsets point to the wrong ones.
  return offset == static_cast<std::int64_t>(parts.state.size())
             ? Status::Ok()
             : Invalid("the variables have " + std::to_string(offset) + " values, the state " +
                       std::to_string(parts.state.size()));
}

// Removed variables and free ids are the same set: each once, and all of them.
Status GraphRestorer::RestoreFree(const std::vector<VariableId>& free, FactorGraph* graph) {
  std::vector<char> seen(graph->variables_.size(), 0);
  for (const VariableId id : free) {
    if (id < 0 || id >= graph->num_variables() || graph->HasVariable(id) ||
        seen[FactorGraph::Index(id)] != 0) {
      return Invalid(VariableName(id) + " is no removed one, or is free twice");
    }
    seen[FactorGraph::Index(id)] = 1;
    // Owned ones only: parts have no borrowed variables.
    graph->edits_->free_variables[FreeKey(graph->AmbientSize(id), false)].push_back(id);
  }
  // Each is removed and listed once, so equal numbers mean equal sets.
  return static_cast<int>(free.size()) == graph->num_removed_variables_
             ? Status::Ok()
             : Invalid("not every removed variable is free");
}

Status GraphRestorer::RestoreValues(GraphParts* parts, FactorGraph* graph) {
  graph->state_ = std::move(parts->state);
  // The room of a removed variable holds zeros, as EditCommit leaves it: Validate looks at all
  // values in one pass.
  for (VariableId id = 0; id < graph->num_variables(); ++id) {
    if (!graph->HasVariable(id)) {
      std::fill_n(graph->state_.begin() + graph->StateOffset(id), graph->AmbientSize(id), 0.0);
    }
  }
  // Whatever is attached to a variable must be of its size, or reading it would go beyond its end.
  const auto fits = [graph](VariableId id, std::size_t size) {
    return graph->HasVariable(id) && size == FactorGraph::Index(graph->AmbientSize(id));
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
    if (!graph->HasVariable(id)) {
      return Invalid(VariableName(id) + " is in an elimination group, and is not there");
    }
    graph->SetEliminationGroup(id, group);
  }
  // Taken over after all have been looked at.
  graph->bounds_ = std::move(parts->bounds);
  graph->pins_ = std::move(parts->pins);
  return Status::Ok();
}

// The family by value: what has passed is moved into the graph.
Status GraphRestorer::RestoreFamily(GraphParts::Family given, FactorGraph* graph) {
  if (given.family == nullptr) {
    return Invalid("family " + std::to_string(graph->num_families()) + " is missing");
  }
  const FactorFamily& family = *given.family;
  const std::string name = FamilyName(graph->num_families(), family);
  const auto num_slots = static_cast<std::size_t>(family.num_slots());
  const auto num_places = static_cast<std::size_t>(given.num_factors);
  // Sizes of arrays first; the ids in them are for Validate.
  if (given.num_factors < 0 || given.num_factors > family.size() ||
      given.variables.size() != num_places * num_slots ||
      (!given.losses.empty() && given.losses.size() != num_places)) {
    return Invalid(name + " has other factors than measurements, variables or losses");
  }
  // Places start as taken; those that are listed are freed one by one, and a second time is an
  // error.
  FamilyEditState edits;
  edits.places.assign(num_places, Place::kIncremental);
  edits.generations.assign(num_places, 0);
  for (const std::int32_t place : given.free_places) {
    if (place < 0 || FactorGraph::Index(place) >= num_places ||
        edits.places[FactorGraph::Index(place)] == Place::kFree) {
      return Invalid(name + ": place " + std::to_string(place) +
                     " does not exist, or is free twice");
    }
    edits.places[FactorGraph::Index(place)] = Place::kFree;
    // As after one removal.
    edits.generations[FactorGraph::Index(place)] = 1;
    // As a removed factor leaves them.
    std::fill_n(given.variables.begin() +
                    static_cast<std::ptrdiff_t>(place) * static_cast<std::ptrdiff_t>(num_slots),
                num_slots, -1);
    if (!given.losses.empty()) {
      given.losses[FactorGraph::Index(place)] = nullptr;
    }
  }
  // More measurements than places, or anything free: only an edit leads there, and Validate allows
  // it only then.
  graph->edits_->edited =
      graph->edits_->edited || !given.free_places.empty() || given.num_factors < family.size();
  if (given.free_places.empty()) {
    edits = FamilyEditState();  // as a family that no edit has looked at
  }
  FamilyRecord record;
  record.family = std::move(given.family);
  record.variables = std::move(given.variables);
  record.losses = std::move(given.losses);
  record.num_factors = static_cast<int>(num_places);
  record.free_places = std::move(given.free_places);
  graph->families_.push_back(std::move(record));
  graph->edits_->families.push_back(std::move(edits));
  return Status::Ok();
}

Status GraphRestorer::Restore(GraphParts parts, FactorGraph* graph) {
  // A fresh graph; the first error ends it, and it is thrown away.
  FactorGraph restored;
  Status status = RestoreVariables(parts, &restored);
  status = status.ok() ? RestoreFree(parts.free_variables, &restored) : status;
  status = status.ok() ? RestoreValues(&parts, &restored) : status;
  for (GraphParts::Family& family : parts.families) {
    status = status.ok() ? RestoreFamily(std::move(family), &restored) : status;
  }
  // An edit is what removes variables.
  restored.edits_->edited = restored.edits_->edited || restored.num_removed_variables_ > 0;
  status = status.ok() ? restored.Validate() : status;
  if (status.ok()) {
    // Edits that were begun on the graph as it was are refused from now on.
    restored.revision_ = graph->revision_ + 1;
    *graph = std::move(restored);
  }
  return status;
}

}  // namespace inceres::internal
