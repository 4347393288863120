#include <algorithm>

#include "problem/edit_check.h"

// How an edit is drawn into marks, and what can be seen to be wrong meanwhile. What it does is
// marked in arrays beside the graph, and See and PlaceOf show each variable and place as it would
// be afterwards. So the rules of a factor are written once, for graphs and for edits. The order is
// that of the edit: comers are announced first, since what goes must not name them, then factors
// go, variables go with their factors, constants change.
//
// Marks are scratch memory that stays allocated. The destructor wipes those that were set, and no
// others: a check costs as much as the edit, not as the graph.

namespace inceres::internal {

// Also after a success: what goes and comes is then in the edit and in removed_, which Commit
// reads.
EditCheck::~EditCheck() {
  const auto wipe = [this](VariableId id) {
    // An id of an edit that is refused may lie anywhere.
    if (id >= 0 && IndexOf(id) < edited_.scratch->marks.size()) {
      mark(id) = VariableMark();
    }
  };
  for (const GraphEdit::NewVariable& variable : edit_.new_variables()) {
    wipe(variable.id);
  }
  std::for_each(edit_.removed_variables().begin(), edit_.removed_variables().end(), wipe);
  for (const auto& [id, constant] : edit_.constants()) {
    wipe(id);
  }
  edited_.scratch->comers.clear();
  // Removed factors, the cascade included, are there until Commit.
  for (const FactorId id : removed_) {
    if (PlaceOf(id) == PlaceState::kGoing) {
      edited_.factors->MarkPlace(id, PlaceState::kIncremental);
    }
  }
  // Free, whether the place existed before; one that was appended is cut off again.
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    if (factor.id.index >= 0 && PlaceOf(factor.id) == PlaceState::kComing) {
      edited_.factors->MarkPlace(factor.id, PlaceState::kFree);
      edited_.factors->ForgetPlacesBeyond(factor.id.family);
    }
  }
}

Status EditCheck::Draw() {
  MarkComers();
  Status status = MarkGoingFactors();
  status = status.ok() ? MarkGoingVariables() : status;
  return status.ok() ? MarkConstants() : status;
}

void EditCheck::MarkComers() {
  // Room for an id that each of them could be given, all appended.
  EditState& scratch = *edited_.scratch;
  const std::size_t num_ids = IndexOf(edited_.variables->size()) + edit_.new_variables().size();
  if (scratch.marks.size() < num_ids) {
    scratch.marks.resize(num_ids);
  }
  for (const GraphEdit::NewVariable& variable : edit_.new_variables()) {
    // An index into comers: a variable has a mark of one word, its record is kept apart.
    mark(variable.id).new_variable = static_cast<std::int32_t>(scratch.comers.size());
    // The record that Commit would make, so that rules see sizes, role and manifold.
    scratch.comers.push_back(RecordOf(variable));
  }
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    // Negative where the family does not exist; that is told later, in the order of the rules.
    if (factor.id.index >= 0) {
      edited_.factors->MarkPlace(factor.id, PlaceState::kComing);
    }
  }
}

Status EditCheck::MarkGoingFactors() {
  return CheckEach(edit_.removed_factors(), [this](FactorId id) {
    // Each place once: the second time it is kGoing already, which is an error of its own.
    Status status = CheckFactorId("RemoveFactor", id, /*may_come=*/false);
    if (status.ok()) {
      removed_.push_back(id);
      edited_.factors->MarkPlace(id, PlaceState::kGoing);
    }
    return status;
  });
}

Status EditCheck::MarkGoingVariables() {
  Status status = CheckEach(edit_.removed_variables(), [this](VariableId id) {
    Status is_there = CheckVariableId("RemoveVariable", id, /*may_come=*/false);
    if (is_there.ok()) {
      mark(id).going = true;
    }
    return is_there;
  });
  // Only then is a pass over all factors worth it, the first time, to know which touch which.
  if (status.ok() && !edit_.removed_variables().empty()) {
    MarkCascade();
  }
  return status;
}

// Factors go with their variables, as in Ceres. Those that the edit removes by itself are marked,
// and so are those of two removed variables: each is listed once.
void EditCheck::MarkCascade() {
  edited_.factors->KeepLists(edited_.variables->size());
  for (const VariableId id : edit_.removed_variables()) {
    graph_.ForEachFactorOf(id, [this](FactorId factor) {
      if (PlaceOf(factor) == PlaceState::kIncremental) {
        removed_.push_back(factor);
        edited_.factors->MarkPlace(factor, PlaceState::kGoing);
      }
    });
  }
}

Status EditCheck::MarkConstants() {
  return CheckEach(edit_.constants(), [this](const auto& wish) {
    const auto& [id, constant] = wish;
    Status status = CheckVariableId("SetConstant", id, /*may_come=*/true);
    // A borrowed constant has no place in the state to which a step could be added.
    if (status.ok() && See(id).record->offset < 0) {
      return Invalid("SetConstant: " + VariableName(id) +
                     " is a borrowed constant, which stays one");
    }
    if (status.ok()) {
      mark(id).constant = constant ? 1 : 0;
    }
    return status;
  });
}

// The graph's own view first, then what the edit changes: added, removed, held or set free.
Sight EditCheck::See(VariableId id) const {
  // marks has room for every id that the edit could name.
  if (id < 0 || IndexOf(id) >= edited_.scratch->marks.size()) {
    return {nullptr, false, Fault::kDanglingId};
  }
  const VariableMark& marked = mark(id);
  // An id that is used again is a removed one to the graph, and a new variable to the edit.
  Sight sight = internal::See(*edited_.variables, id);
  if (marked.new_variable >= 0) {
    const VariableRecord& comer = edited_.scratch->comers[IndexOf(marked.new_variable)];
    sight = {&comer, comer.constant, Fault::kNone};
  }
  if (marked.going) {
    sight.fault = Fault::kGoing;
  }
  // The last word has SetConstant, on new variables too.
  if (marked.constant >= 0) {
    sight.constant = marked.constant == 1;
  }
  return sight;
}

// Each variable once, and only where the edit's last word sets it free; one that comes is checked
// with what it comes with.
bool EditCheck::IsFreed(VariableId id) {
  VariableMark& marked = mark(id);
  if (marked.checked || marked.constant != 0 || marked.new_variable >= 0 ||
      graph_.IsConstant(id) == See(id).constant) {
    return false;
  }
  marked.checked = true;
  return true;
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
      return fail(" does not exist: the graph has " + std::to_string(edited_.variables->size()) +
                  " variables");
    case Fault::kRemoved:
      return fail(" has been removed");
    case Fault::kGoing:
      return fail(may_come ? " is removed by the same edit" : " is removed twice");
    default:
      break;
  }
  // Order within an edit: what goes does so before anything comes.
  if (!may_come && mark(id).new_variable >= 0) {
    return fail(" is added by the same edit: variables go before others come");
  }
  return Status::Ok();
}

Status EditCheck::CheckFactorId(const char* call, FactorId id, bool may_come) const {
  const auto fail = [&](const std::string& what) {
    return Invalid(std::string(call) + ": " + FactorName(id) + what);
  };
  if (id.family < 0 || id.family >= edited_.factors->size()) {
    return Invalid(NoFamily(call, graph_, id.family));
  }
  // Places may come beyond the graph's, by this edit.
  const auto num_marked = static_cast<int>((*edited_.factors)[id.family].places.size());
  if (id.index < 0 || id.index >= std::max(graph_.NumFactors(id.family), num_marked)) {
    return fail(" does not exist: the family has " + std::to_string(graph_.NumFactors(id.family)) +
                " places");
  }
  const PlaceState place = PlaceOf(id);
  // The place was given to another factor: an id from before must not reach it.
  if (id.generation >= 0 && id.generation != graph_.Generation(id.family, id.index) &&
      place != PlaceState::kFree) {
    return fail(" has been removed, and its place given to another one");
  }
  switch (place) {
    case PlaceState::kFree:
      return fail(" has been removed");
    case PlaceState::kGoing:
      return fail(may_come ? " is removed by the same edit" : " is removed twice");
    case PlaceState::kComing:
      return may_come ? Status::Ok()
                      : fail(" is added by the same edit: factors go before others come");
    case PlaceState::kIncremental:
      break;
  }
  return Status::Ok();
}

}  // namespace inceres::internal
