// How an edit is drawn into marks on the variables and places it concerns, and what can be seen to be wrong meanwhile.
#include <algorithm>

#include "problem/edit_check.h"
#include "problem/find_fault.h"

namespace inceres::internal {

EditCheck::~EditCheck() {
  const auto wipe = [this](VariableId id) {
    if (id >= 0 && Graph::Index(id) < graph_.marks_.size()) {
      graph_.marks_[Graph::Index(id)] = Graph::VariableMark();
    }
  };
  for (const GraphEdit::NewVariable& variable : edit_.new_variables()) {
    wipe(variable.id);
  }
  std::for_each(edit_.removed_variables().begin(), edit_.removed_variables().end(), wipe);
  for (const auto& [id, constant] : edit_.constants()) {
    wipe(id);
  }
  graph_.comers_.clear();
  for (const FactorId id : removed_) {
    if (PlaceOf(id) == Graph::Place::kGoing) {
      MutablePlace(id) = Graph::Place::kIncremental;
    }
  }
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    if (factor.id.index >= 0 && PlaceOf(factor.id) == Graph::Place::kComing) {
      Graph::FamilyRecord& record = graph_.families_[Graph::Index(factor.id.family)];
      MutablePlace(factor.id) = Graph::Place::kFree;
      if (factor.id.index >= record.num_factors) {
        record.places.resize(Graph::Index(record.num_factors));
      }
    }
  }
}

void EditCheck::MarkComers() {
  // Room for an id that each of them could be given, all appended.
  const std::size_t num_ids = graph_.variables_.size() + edit_.new_variables().size();
  if (graph_.marks_.size() < num_ids) {
    graph_.marks_.resize(num_ids);
  }
  for (const GraphEdit::NewVariable& variable : edit_.new_variables()) {
    graph_.marks_[Graph::Index(variable.id)].new_variable = static_cast<std::int32_t>(graph_.comers_.size());
    graph_.comers_.push_back(variable.is_borrowed ? Graph::MakeBorrowed(variable.borrowed, variable.ambient_size)
                                                  : Graph::MakeOwned(variable.ambient_size, variable.role, variable.manifold));
  }
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    if (factor.id.index >= 0) {
      MutablePlace(factor.id) = Graph::Place::kComing;
    }
  }
}

Status EditCheck::MarkGoingFactors() {
  for (const FactorId id : edit_.removed_factors()) {
    Status status = CheckFactorId("RemoveFactor", id, /*may_come=*/false);
    if (!status.ok()) {
      return status;
    }
    removed_.push_back(id);
    MutablePlace(id) = Graph::Place::kGoing;
  }
  return Status::Ok();
}

Status EditCheck::MarkGoingVariables() {
  for (const VariableId id : edit_.removed_variables()) {
    Status status = CheckVariableId("RemoveVariable", id, /*may_come=*/false);
    if (!status.ok()) {
      return status;
    }
    graph_.marks_[Graph::Index(id)].going = true;
  }
  if (!edit_.removed_variables().empty()) {
    MarkCascade();
  }
  return Status::Ok();
}

void EditCheck::MarkCascade() {
  graph_.TrackFactors();
  for (const VariableId id : edit_.removed_variables()) {
    graph_.ForEachFactorOf(id, [this](FactorId factor) {
      if (PlaceOf(factor) == Graph::Place::kIncremental) {
        removed_.push_back(factor);
        MutablePlace(factor) = Graph::Place::kGoing;
      }
    });
  }
}

Status EditCheck::MarkConstants() {
  for (const auto& [id, constant] : edit_.constants()) {
    Status status = CheckVariableId("SetConstant", id, /*may_come=*/true);
    if (status.ok() && See(id).record->offset < 0) {
      status = Invalid("SetConstant: " + VariableName(id) + " is a borrowed constant, which stays one");
    }
    if (!status.ok()) {
      return status;
    }
    graph_.marks_[Graph::Index(id)].constant = constant ? 1 : 0;
  }
  return Status::Ok();
}

FactorGraph::Place EditCheck::PlaceOf(FactorId id) const {
  const Graph::FamilyRecord& record = graph_.families_[Graph::Index(id.family)];
  const std::size_t index = Graph::Index(id.index);
  return index < record.places.size() ? record.places[index] : Graph::Place::kIncremental;
}

FactorGraph::Place& EditCheck::MutablePlace(FactorId id) {
  Graph::FamilyRecord& record = graph_.families_[Graph::Index(id.family)];
  const std::size_t size = Graph::Index(std::max(record.num_factors, id.index + 1));
  if (record.places.size() < size) {
    record.places.resize(size, Graph::Place::kIncremental);
  }
  return record.places[Graph::Index(id.index)];
}

FactorGraph::Sight EditCheck::See(VariableId id) const {
  if (id < 0 || Graph::Index(id) >= graph_.marks_.size()) {
    return {nullptr, false, Graph::Fault::kDanglingId};
  }
  const Graph::VariableMark& mark = graph_.marks_[Graph::Index(id)];
  Graph::Sight sight = graph_.See(id);
  if (mark.new_variable >= 0) {
    const Graph::VariableRecord& comer = graph_.comers_[Graph::Index(mark.new_variable)];
    sight = {&comer, comer.constant, Graph::Fault::kNone};
  }
  if (mark.going) {
    sight.fault = Graph::Fault::kGoing;
  }
  if (mark.constant >= 0) {
    sight.constant = mark.constant == 1;
  }
  return sight;
}

std::string EditCheck::FactorName(FactorId id) const {
  return "factor " + std::to_string(id.index) + " of " + FamilyName(id.family, graph_.family(id.family));
}

Status EditCheck::CheckVariableId(const char* call, VariableId id, bool may_come) const {
  const auto fail = [&](const std::string& what) { return Invalid(std::string(call) + ": " + VariableName(id) + what); };
  switch (See(id).fault) {
    case Graph::Fault::kDanglingId:
      return fail(" does not exist: the graph has " + std::to_string(graph_.num_variables()) + " variables");
    case Graph::Fault::kRemoved:
      return fail(" has been removed");
    case Graph::Fault::kGoing:
      return fail(may_come ? " is removed by the same edit" : " is removed twice");
    default:
      break;
  }
  if (!may_come && graph_.marks_[Graph::Index(id)].new_variable >= 0) {
    return fail(" is added by the same edit: variables go before others come");
  }
  return Status::Ok();
}

Status EditCheck::CheckFactorId(const char* call, FactorId id, bool may_come) const {
  const auto fail = [&](const std::string& what) { return Invalid(std::string(call) + ": " + FactorName(id) + what); };
  if (id.family < 0 || id.family >= graph_.num_families()) {
    return Invalid(std::string(call) + ": there is no family " + std::to_string(id.family));
  }
  const auto num_marked = static_cast<int>(graph_.families_[Graph::Index(id.family)].places.size());
  if (id.index < 0 || id.index >= std::max(graph_.NumFactors(id.family), num_marked)) {
    return fail(" does not exist: the family has " + std::to_string(graph_.NumFactors(id.family)) + " places");
  }
  switch (PlaceOf(id)) {
    case Graph::Place::kFree:
      return fail(" has been removed");
    case Graph::Place::kGoing:
      return fail(may_come ? " is removed by the same edit" : " is removed twice");
    case Graph::Place::kComing:
      return may_come ? Status::Ok() : fail(" is added by the same edit: factors go before others come");
    case Graph::Place::kIncremental:
      break;
  }
  return Status::Ok();
}

}  // namespace inceres::internal
