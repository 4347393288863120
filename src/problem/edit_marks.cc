// How an edit is drawn into marks on the variables and places it concerns, and what can be seen to
// be wrong meanwhile.
#include <algorithm>

#include "problem/edit_check.h"
#include "problem/find_fault.h"

// An edit is checked without being carried out: what it does is marked in arrays beside the graph,
// and See and PlaceOf show each variable and place as it would be afterwards. So the rules of a
// factor are written once, for graphs and for edits. The order is that of the edit: comers are
// announced first, since what goes must not name them, then factors go, variables go with their
// factors, constants change.
//
// Marks are scratch memory that stays allocated. The destructor wipes those that were set, and no
// others: a check costs as much as the edit, not as the graph.

namespace inceres::internal {

// Also after a success: what goes and comes is then in the edit and in removed_, which Commit
// reads.
EditCheck::~EditCheck() {
  const auto wipe = [this](VariableId id) {
    // An id of an edit that is refused may lie anywhere.
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
  // Removed factors, the cascade included, are there until Commit.
  for (const FactorId id : removed_) {
    if (PlaceOf(id) == Place::kGoing) {
      MutablePlace(id) = Place::kIncremental;
    }
  }
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    if (factor.id.index >= 0 && PlaceOf(factor.id) == Place::kComing) {
      const FamilyRecord& record = graph_.families_[Graph::Index(factor.id.family)];
      // Free, whether the place existed before; a place that was appended is cut off below, since
      // num_factors still counts without it.
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
    // An index into comers: a variable has a mark of one word, its record is kept apart.
    edits_.marks[Graph::Index(variable.id)].new_variable =
        static_cast<std::int32_t>(edits_.comers.size());
    // The record that Commit would make, so that rules see sizes, role and manifold.
    edits_.comers.push_back(
        variable.is_borrowed ? MakeBorrowed(variable.borrowed, variable.ambient_size)
                             : MakeOwned(variable.ambient_size, variable.role, variable.manifold));
  }
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    // Negative where the family does not exist; that is told later, in the order of the rules.
    if (factor.id.index >= 0) {
      MutablePlace(factor.id) = Place::kComing;
    }
  }
}

Status EditCheck::MarkGoingFactors() {
  for (const FactorId id : edit_.removed_factors()) {
    Status status = CheckFactorId("RemoveFactor", id, /*may_come=*/false);
    // Each place once: the second time it is kGoing already, which is an error of its own.
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
  // Only then is a pass over all factors worth it, the first time, to know which touch which.
  if (!edit_.removed_variables().empty()) {
    MarkCascade();
  }
  return Status::Ok();
}

// Factors go with their variables, as in Ceres. Those that the edit removes by itself are marked,
// and so are those of two removed variables: each is listed once.
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
    // A borrowed constant has no place in the state to which a step could be added.
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

// Without marks everything below num_factors is a factor: most families are never edited.
Place EditCheck::PlaceOf(FactorId id) const {
  const std::vector<Place>& places = edits_.families[Graph::Index(id.family)].places;
  const std::size_t index = Graph::Index(id.index);
  return index < places.size() ? places[index] : Place::kIncremental;
}

Place& EditCheck::MutablePlace(FactorId id) {
  // The array comes into being with the first mark, as long as the family or as far as the new
  // place.
  std::vector<Place>& places = edits_.families[Graph::Index(id.family)].places;
  const std::size_t size = Graph::Index(std::max(graph_.NumFactors(id.family), id.index + 1));
  if (places.size() < size) {
    places.resize(size, Place::kIncremental);
  }
  return places[Graph::Index(id.index)];
}

// The graph's own view first, then what the edit changes: added, removed, held or set free.
Sight EditCheck::See(VariableId id) const {
  // marks has room for every id that the edit could name.
  if (id < 0 || Graph::Index(id) >= edits_.marks.size()) {
    return {nullptr, false, Fault::kDanglingId};
  }
  const VariableMark& mark = edits_.marks[Graph::Index(id)];
  // An id that is used again is a removed one to the graph, and a new variable to the edit.
  Sight sight = internal::See(graph_.variables_, id);
  if (mark.new_variable >= 0) {
    const VariableRecord& comer = edits_.comers[Graph::Index(mark.new_variable)];
    sight = {&comer, comer.constant, Fault::kNone};
  }
  if (mark.going) {
    sight.fault = Fault::kGoing;
  }
  // The last word has SetConstant, on new variables too.
  if (mark.constant >= 0) {
    sight.constant = mark.constant == 1;
  }
  return sight;
}

std::string EditCheck::FactorName(FactorId id) const {
  return "factor " + std::to_string(id.index) + " of " +
         FamilyName(id.family, graph_.family(id.family));
}

// `may_come`: whether the call may name what the same edit adds.
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
  // Order within an edit: what goes does so before anything comes.
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
  // Places may come beyond the graph's, by this edit.
  const auto num_marked = static_cast<int>(edits_.families[Graph::Index(id.family)].places.size());
  if (id.index < 0 || id.index >= std::max(graph_.NumFactors(id.family), num_marked)) {
    return fail(" does not exist: the family has " + std::to_string(graph_.NumFactors(id.family)) +
                " places");
  }
  const Place place = PlaceOf(id);
  // The place was given to another factor: an id from before must not reach it.
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
