// The rules an edit must keep, looked at with its marks laid over the graph.
#include <cmath>
#include <limits>
#include <new>

#include "problem/edit_marks.h"

// An edit is refused as a whole or carried out as a whole, so that everything that may go wrong
// must be known before anything is changed: Check finds it, and makes room, and Commit
// (edit_commit.cc) changes the graph. Between the two IncrementalSystem takes what goes out of its
// own arrays, while the graph still has it; nothing else may happen to the graph there.
//
// The edit is drawn into marks first (edit_marks.cc), and every rule is then looked at with the
// marks over the graph. A rule sees the graph as it would be, and the rules of variables and
// factors are the same ones that Validate uses (find_fault.h). Cost: what the edit names, not the
// size of the graph; only the first look for the factors of a variable goes over all of them.

namespace inceres {
namespace internal {
namespace {

// The message has the value and its place in the variable.
Status CheckFinite(const char* call, VariableId id, const double* values, int size) {
  for (int k = 0; k < size; ++k) {
    if (!std::isfinite(values[k])) {
      return Invalid(std::string(call) + ": value " + std::to_string(k) + " of " +
                     VariableName(id) + " is " + std::to_string(values[k]));
    }
  }
  return Status::Ok();
}

/// The rules, one kind of wish after the other, in the order of the edit: the first one that is
/// broken is told.
class EditRules {
 public:
  EditRules(const EditedGraph& edited, const GraphEdit& edit, EditMarks* marks)
      : edited_(edited), graph_(*edited.graph), edit_(edit), marks_(*marks) {}

  Status Check() {
    Status status = CheckComingVariables();
    for (const auto rule :
         {&EditRules::CheckComingFactors, &EditRules::CheckFreedVariables,
          &EditRules::CheckFactorSettings, &EditRules::CheckNewValues, &EditRules::CheckPins,
          &EditRules::CheckBounds, &EditRules::CheckGroups}) {
      status = status.ok() ? (this->*rule)() : status;
    }
    return status;
  }

 private:
  Status CheckComingVariables();
  Status CheckComingFactors();
  Status CheckFreedVariables();
  Status CheckFactorSettings();
  Status CheckNewValues();
  Status CheckPins();
  Status CheckBounds();
  Status CheckGroups();
  Status CheckFactor(FactorId id, const VariableId* ids) const;
  Status CheckFreedFactors(VariableId id) const;

  const EditedGraph& edited_;
  const FactorGraph& graph_;
  const GraphEdit& edit_;
  EditMarks& marks_;
};

Status EditRules::CheckComingVariables() {
  Status status;
  for (std::size_t i = 0; status.ok() && i < marks_.comers().size(); ++i) {
    const GraphEdit::NewVariable& variable = edit_.new_variables()[i];
    // comers has the records that Commit would make, in the order of the edit.
    status = ValidateVariable(variable.id, marks_.comers()[i], marks_.See(variable.id).constant);
    if (status.ok() && !variable.has_values) {
      status = Invalid("AddVariable: " + VariableName(variable.id) + " is given a null pointer");
    }
    // Values that are borrowed may change until they are read.
    if (status.ok() && !variable.is_borrowed) {
      status = CheckFinite("AddVariable", variable.id, edit_.values().data() + variable.values,
                           variable.ambient_size);
    }
  }
  return status;
}

Status EditRules::CheckComingFactors() {
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    // Connect could give out no place: there is no such family.
    if (factor.id.index < 0) {
      return Invalid(NoFamily("Connect", graph_, factor.id.family));
    }
    const FactorFamily& family = graph_.family(factor.id.family);
    Status status = ValidateSizes(factor.id.family, family);
    if (!status.ok()) {
      return status;
    }
    if (factor.num_variables != IndexOf(family.num_slots())) {
      return Invalid(marks_.FactorName(factor.id) + " is given " +
                     std::to_string(factor.num_variables) + " variables but has " +
                     std::to_string(family.num_slots()) + " slots");
    }
    // The measurement is placed before the edit is applied: by AddFactor, or by the caller of
    // Connect.
    if (family.size() <= factor.id.index) {
      return Invalid(marks_.FactorName(factor.id) + " has no measurement: the family holds " +
                     std::to_string(family.size()));
    }
    status = CheckFactor(factor.id, edit_.factor_variables().data() + factor.variables);
    if (!status.ok()) {
      return status;
    }
  }
  return Status::Ok();
}

// FindFault sees variables as the edit leaves them; the text looks up the culprit in the same way.
Status EditRules::CheckFactor(FactorId id, const VariableId* ids) const {
  AcceptedManifolds accepted;
  const FactorFault fault = FindFault(
      graph_.family(id.family), ids, [this](VariableId variable) { return marks_.See(variable); },
      &accepted);
  return fault.fault == Fault::kNone
             ? Status::Ok()
             : DescribeFault(graph_, id, ids, fault, marks_.See(ids[fault.slot]).record);
}

// A variable that was constant and no longer will be: its own factors were let through with rules
// only a constant may break.
Status EditRules::CheckFreedVariables() {
  for (const auto& [id, constant] : edit_.constants()) {
    if (!marks_.IsFreed(id)) {
      continue;
    }
    // The lists of factors by variable; made the first time that they are needed.
    edited_.factors->KeepLists(graph_.num_variables());
    Status status = ValidateVariable(id, (*edited_.variables)[id], /*constant=*/false);
    // A wrong tangent size, or a second landmark in a factor, is no fault of a constant.
    status = status.ok() ? CheckFreedFactors(id) : status;
    if (!status.ok()) {
      return Invalid("SetConstant(" + std::to_string(id) + ", false): " + status.message);
    }
  }
  return Status::Ok();
}

Status EditRules::CheckFreedFactors(VariableId id) const {
  Status status;
  graph_.ForEachFactorOf(id, [&](FactorId factor) {
    // Factors that go need no rules, and those that come were checked with the variable as it will
    // be.
    if (status.ok() && marks_.PlaceOf(factor) == PlaceState::kIncremental) {
      status = CheckFactor(factor, graph_.Variables(factor.family, factor.index));
    }
  });
  return status;
}

// Only that the factors are there: a loss may be anything, and a measurement is its family's.
Status EditRules::CheckFactorSettings() {
  Status status;
  for (std::size_t i = 0; status.ok() && i < edit_.losses().size(); ++i) {
    status = marks_.CheckFactorId("SetLoss", edit_.losses()[i].first, /*may_come=*/true);
  }
  for (std::size_t i = 0; status.ok() && i < edit_.measurements().size(); ++i) {
    status =
        marks_.CheckFactorId("SetMeasurement", edit_.measurements()[i].first, /*may_come=*/true);
  }
  return status;
}

Status EditRules::CheckNewValues() {
  for (const auto& [id, offset] : edit_.new_values()) {
    Status status = marks_.CheckVariableId("SetValues", id, /*may_come=*/true);
    if (status.ok()) {
      const VariableRecord& variable = *marks_.See(id).record;
      // No room in the state to write to.
      if (variable.offset < 0) {
        status = Invalid("SetValues: " + VariableName(id) +
                         " is a borrowed constant: its values are their owner's to change");
      } else if (offset == GraphEdit::kNoValues) {
        // Here null is a mistake; for pins and bounds it has a meaning.
        status = Invalid("SetValues: " + VariableName(id) + " is given a null pointer");
      } else {
        status =
            CheckFinite("SetValues", id, edit_.values().data() + offset, variable.ambient_size);
      }
    }
    if (!status.ok()) {
      return status;
    }
  }
  return Status::Ok();
}

Status EditRules::CheckPins() {
  Status status;
  for (std::size_t i = 0; status.ok() && i < edit_.pins().size(); ++i) {
    const auto& [id, offset] = edit_.pins()[i];
    status = marks_.CheckVariableId("PinLinearization", id, /*may_come=*/true);
    // Without values the variable is let go of.
    if (status.ok() && offset != GraphEdit::kNoValues) {
      status = CheckFinite("PinLinearization", id, edit_.values().data() + offset,
                           marks_.See(id).record->ambient_size);
    }
  }
  return status;
}

// Pairs of bounds, entry by entry; the side that was not given is infinite. Whether the values lie
// between them is not asked here.
Status EditRules::CheckBounds() {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  for (const GraphEdit::NewBounds& bounds : edit_.bounds()) {
    Status status = marks_.CheckVariableId("SetBounds", bounds.id, /*may_come=*/true);
    if (!status.ok()) {
      return status;
    }
    const auto entry = [this](std::size_t offset, int k, double none) {
      return offset == GraphEdit::kNoValues ? none
                                            : edit_.values()[offset + static_cast<std::size_t>(k)];
    };
    for (int k = 0; k < marks_.See(bounds.id).record->ambient_size; ++k) {
      const double lower = entry(bounds.lower, k, -kNone);
      const double upper = entry(bounds.upper, k, kNone);
      // Equal ones hold the value, which is what a constant is for; NaN fails as well.
      if (!(lower < upper)) {
        return Invalid("SetBounds: value " + std::to_string(k) + " of " + VariableName(bounds.id) +
                       " has the lower bound " + std::to_string(lower) +
                       ", which is not below its upper bound " + std::to_string(upper));
      }
    }
  }
  return Status::Ok();
}

Status EditRules::CheckGroups() {
  Status status;
  for (std::size_t i = 0; status.ok() && i < edit_.elimination_groups().size(); ++i) {
    const auto& [id, group] = edit_.elimination_groups()[i];
    status = marks_.CheckVariableId("SetEliminationGroup", id, /*may_come=*/true);
    if (status.ok() && group < 0) {
      status = Invalid("SetEliminationGroup: " + VariableName(id) + " is given the group " +
                       std::to_string(group) + "; groups are 0 or above");
    }
  }
  return status;
}

}  // namespace
}  // namespace internal

Status FactorGraph::Check(const GraphEdit& edit, std::vector<FactorId>* removed) {
  removed->clear();
  if (&edit.graph() != this) {
    return internal::Invalid("the edit was begun on another graph");
  }
  // From now on a family may hold more measurements than factors: AddFactor has placed them, also
  // where the edit is refused.
  is_edited_ = true;
  // Ids were given out in view of what was free at that revision.
  if (edit.revision() != revision()) {
    return internal::Invalid("the edit was begun at revision " + std::to_string(edit.revision()) +
                             " of the graph, which is now at revision " +
                             std::to_string(revision()) + ": begin it anew");
  }
  // A handle of another graph: what the edit was told cannot be carried out.
  if (!edit.misuse().ok()) {
    return edit.misuse();
  }
  const internal::EditedGraph edited = {this, &variables_, &factors_, &*edits_};
  Status status;
  try {
    internal::EditMarks marks(edited, edit, removed);
    status = marks.Draw();
    status = status.ok() ? internal::EditRules(edited, edit, &marks).Check() : status;
    if (status.ok()) {
      // Once nothing else may fail.
      internal::PrepareCommit(edited, edit, *removed, marks);
    }
  } catch (const std::bad_alloc&) {
    // Marks are wiped by then, and of the graph nothing has changed but the room that vectors have.
    status = Status::Error(StatusCode::kUnavailable, "Out of memory.");
  }
  if (!status.ok()) {
    removed->clear();
  }
  return status;
}

}  // namespace inceres
