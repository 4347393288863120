// How an edit is drawn into marks on the variables and places it concerns, and what can be seen to
// be wrong meanwhile.
#include <algorithm>

#include "problem/edit_check.h"
#include "problem/find_fault.h"

namespace inceres::internal {

EditCheck::~EditCheck() {
  const auto wipe = [this](VariableId id) {
    if (id >= 0 && Graph::Index(id) < edits_.marks.size()) {
      edits_.marks[Graph::Index(id)] = VariableMark();
    }
  };
  for (const GraphEdit::NewVariable& variable : edit_.new_variables()) {
    wipe(variable.id);
  }
  std::for_each(edit_.removed_variables().begin(), edit_.removed_variables().end(), wipe);
  for (const auto& [id, constant] : edit_.constants()) {
    wipe(id);
  }
  edits_.comers.clear();
  for (const FactorId id : removed_) {
    if (PlaceOf(id) == Place::kGoing) {
      MutablePlace(id) = Place::kIncremental;
    }
  }
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    if (factor.id.index >= 0 && PlaceOf(factor.id) == Place::kComing) {
      const FamilyRecord& record = graph_.families_[Graph::Index(factor.id.family)];
      MutablePlace(factor.id) = Place::kFree;
      if (factor.id.index >= record.num_factors) {
        edits_.families[Graph::Index(factor.id.family)].places.resize(
            Graph::Index(record.num_factors));
      }
    }
  }
}

void EditCheck::MarkComers() {
  // Room for an id that each of them could be given, all appended.
  const std::size_t num_ids = graph_.variables_.size() + edit_.new_variables().size();
  if (edits_.marks.size() < num_ids) {
    edits_.marks.resize(num_ids);
  }
  for (const GraphEdit::NewVariable& variable : edit_.new_variables()) {
    edits_.marks[Graph::Index(variable.id)].new_variable =
        static_cast<std::int32_t>(edits_.comers.size());
    edits_.comers.push_back(
        variable.is_borrowed ? MakeBorrowed(variable.borrowed, variable.ambient_size)
                             : MakeOwned(variable.ambient_size, variable.role, variable.manifold));
  }
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    if (factor.id.index >= 0) {
      MutablePlace(factor.id) = Place::kComing;
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
    MutablePlace(id) = Place::kGoing;
  }
  return Status::Ok();
}

Status EditCheck::MarkGoingVariables() {
  for (const VariableId id : edit_.removed_variables()) {
    Status status = CheckVariableId("RemoveVariable", id, /*may_come=*/false);
    if (!status.ok()) {
      return status;
    }
    edits_.marks[Graph::Index(id)].going = true;
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
      if (PlaceOf(factor) == Place::kIncremental) {
        removed_.push_back(factor);
        MutablePlace(factor) = Place::kGoing;
      }
    });
  }
}

Status EditCheck::MarkConstants() {
  for (const auto& [id, constant] : edit_.constants()) {
    Status status = CheckVariableId("SetConstant", id, /*may_come=*/true);
    if (status.ok() && See(id).record->offset < 0) {
      status =
          Invalid("SetConstant: " + VariableName(id) + " is a borrowed constant, which stays one");
    }
    if (!status.ok()) {
      return status;
    }
    edits_.marks[Graph::Index(id)].constant = constant ? 1 : 0;
  }
  return Status::Ok();
}

Place EditCheck::PlaceOf(FactorId id) const {
  const std::vector<Place>& places = edits_.families[Graph::Index(id.family)].places;
  const std::size_t index = Graph::Index(id.index);
  return index < places.size() ? places[index] : Place::kIncremental;
}

Place& EditCheck::MutablePlace(FactorId id) {
  std::vector<Place>& places = edits_.families[Graph::Index(id.family)].places;
  const std::size_t size = Graph::Index(std::max(graph_.NumFactors(id.family), id.index + 1));
  if (places.size() < size) {
    places.resize(size, Place::kIncremental);
  }
  return places[Graph::Index(id.index)];
}

Sight EditCheck::See(VariableId id) const {
  if (id < 0 || Graph::Index(id) >= edits_.marks.size()) {
    return {nullptr, false, Fault::kDanglingId};
  }
  const VariableMark& mark = edits_.marks[Graph::Index(id)];
  Sight sight = internal::See(graph_.variables_, id);
  if (mark.new_variable >= 0) {
    const VariableRecord& comer = edits_.comers[Graph::Index(mark.new_variable)];
    sight = {&comer, comer.constant, Fault::kNone};
  }
  if (mark.going) {
    sight.fault = Fault::kGoing;
  }
  if (mark.constant >= 0) {
    sight.constant = mark.constant == 1;
  }
  return sight;
}

std::string EditCheck::FactorName(FactorId id) const {
  return "factor " + std::to_string(id.index) + " of " +
         FamilyName(id.family, graph_.family(id.family));
}

Status EditCheck::CheckVariableId(const char* call, VariableId id, bool may_come) const {
  const auto fail = [&](const std::string& what) {
    return Invalid(std::string(call) + ": " + VariableName(id) + what);
  };
  switch (See(id).fault) {
    case Fault::kDanglingId:
      return fail(" does not exist: the graph has " + std::to_string(graph_.num_variables()) +
                  " variables");
    case Fault::kRemoved:
      return fail(" has been removed");
    case Fault::kGoing:
      return fail(may_come ? " is removed by the same edit" : " is removed twice");
    default:
      break;
  }
  if (!may_come && edits_.marks[Graph::Index(id)].new_variable >= 0) {
    return fail(" is added by the same edit: variables go before others come");
  }
  return Status::Ok();
}

Status EditCheck::CheckFactorId(const char* call, FactorId id, bool may_come) const {
  const auto fail = [&](const std::string& what) {
    return Invalid(std::string(call) + ": " + FactorName(id) + what);
  };
  if (id.family < 0 || id.family >= graph_.num_families()) {
    return Invalid(NoFamily(call, graph_, id.family));
  }
  const auto num_marked = static_cast<int>(edits_.families[Graph::Index(id.family)].places.size());
  if (id.index < 0 || id.index >= std::max(graph_.NumFactors(id.family), num_marked)) {
    return fail(" does not exist: the family has " + std::to_string(graph_.NumFactors(id.family)) +
                " places");
  }
  const Place place = PlaceOf(id);
  if (id.generation >= 0 && id.generation != graph_.Generation(id.family, id.index) &&
      place != Place::kFree) {
    return fail(" has been removed, and its place given to another one");
  }
  switch (place) {
    case Place::kFree:
      return fail(" has been removed");
    case Place::kGoing:
      return fail(may_come ? " is removed by the same edit" : " is removed twice");
    case Place::kComing:
      return may_come ? Status::Ok()
                      : fail(" is added by the same edit: factors go before others come");
    case Place::kIncremental:
      break;
  }
  return Status::Ok();
}

}  // namespace inceres::internal
