// The rules an edit must keep, looked at with its marks laid over the graph.
#include "problem/edit_check.h"

#include <limits>
#include <new>

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

// Pairs of bounds, entry by entry; the side that was not given is infinite. Whether the values lie
// between them is not asked here.
Status CheckOrder(const GraphEdit& edit, const GraphEdit::NewBounds& bounds, int size) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const auto entry = [&edit](std::size_t offset, int k, double none) {
    return offset == GraphEdit::kNoValues ? none
                                          : edit.values()[offset + static_cast<std::size_t>(k)];
  };
  for (int k = 0; k < size; ++k) {
    const double lower = entry(bounds.lower, k, -kNone);
    const double upper = entry(bounds.upper, k, kNone);
    // Equal ones hold the value, which is what a constant is for; NaN fails as well.
    if (!(lower < upper)) {
      return Invalid("SetBounds: value " + std::to_string(k) + " of " + VariableName(bounds.id) +
                     " has the lower bound " + std::to_string(lower) +
                     ", which is not below its upper bound " + std::to_string(upper));
    }
  }
  return Status::Ok();
}

}  // namespace

Status EditCheck::Check() {
  Status status = Draw();
  for (const auto rule : {&EditCheck::CheckComingVariables, &EditCheck::CheckComingFactors,
                          &EditCheck::CheckFreedVariables, &EditCheck::CheckFactorSettings,
                          &EditCheck::CheckNewValues, &EditCheck::CheckPins,
                          &EditCheck::CheckBounds, &EditCheck::CheckGroups}) {
    status = status.ok() ? (this->*rule)() : status;
  }
  return status;
}

Status EditCheck::CheckComingVariables() {
  return CheckEach(edit_.new_variables(), [this](const GraphEdit::NewVariable& variable) {
    // The record is the one that Commit would make.
    const Sight sight = See(variable.id);
    Status status = ValidateVariable(variable.id, *sight.record, sight.constant);
    if (status.ok() && !variable.has_values) {
      return Invalid("AddVariable: " + VariableName(variable.id) + " is given a null pointer");
    }
    // Values that are borrowed may change until they are read.
    if (status.ok() && !variable.is_borrowed) {
      return CheckFinite("AddVariable: ", "", variable.id, edit_.values().data() + variable.values,
                         variable.ambient_size);
    }
    return status;
  });
}

Status EditCheck::CheckComingFactors() {
  return CheckEach(edit_.new_factors(), [this](const GraphEdit::NewFactor& factor) {
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
      return Invalid(FactorName(factor.id) + " is given " + std::to_string(factor.num_variables) +
                     " variables but has " + std::to_string(family.num_slots()) + " slots");
    }
    // The measurement is placed before the edit is applied: by AddFactor, or by the caller of
    // Connect.
    if (family.size() <= factor.id.index) {
      return Invalid(FactorName(factor.id) + " has no measurement: the family holds " +
                     std::to_string(family.size()));
    }
    return CheckFactor(factor.id, edit_.factor_variables().data() + factor.variables);
  });
}

// FindFault sees variables as the edit leaves them; the text looks up the culprit in the same way.
Status EditCheck::CheckFactor(FactorId id, const VariableId* ids) const {
  AcceptedManifolds accepted;
  const FactorFault fault = FindFault(
      graph_.family(id.family), ids, [this](VariableId variable) { return See(variable); },
      &accepted);
  return fault.fault == Fault::kNone
             ? Status::Ok()
             : DescribeFault(graph_, id, ids, fault, See(ids[fault.slot]).record);
}

// A variable that was constant and no longer will be: its own factors were let through with rules
// only a constant may break.
Status EditCheck::CheckFreedVariables() {
  return CheckEach(edit_.constants(), [this](const auto& wish) {
    const VariableId id = wish.first;
    if (!IsFreed(id)) {
      return Status::Ok();
    }
    // The lists of factors by variable; made the first time that they are needed.
    edited_.factors->KeepLists(graph_.num_variables());
    Status status = ValidateVariable(id, (*edited_.variables)[id], /*constant=*/false);
    // A wrong tangent size, or a second landmark in a factor, is no fault of a constant.
    status = status.ok() ? CheckFreedFactors(id) : status;
    return status.ok()
               ? status
               : Invalid("SetConstant(" + std::to_string(id) + ", false): " + status.message);
  });
}

Status EditCheck::CheckFreedFactors(VariableId id) const {
  Status status;
  graph_.ForEachFactorOf(id, [&](FactorId factor) {
    // Factors that go need no rules, and those that come were checked with the variable as it will
    // be.
    if (status.ok() && PlaceOf(factor) == PlaceState::kIncremental) {
      status = CheckFactor(factor, graph_.Variables(factor.family, factor.index));
    }
  });
  return status;
}

// Only that the factors are there: a loss may be anything, and a measurement is its family's.
Status EditCheck::CheckFactorSettings() {
  const Status losses = CheckEach(edit_.losses(), [this](const auto& wish) {
    return CheckFactorId("SetLoss", wish.first, /*may_come=*/true);
  });
  const auto check_measurement = [this](const auto& wish) {
    return CheckFactorId("SetMeasurement", wish.first, /*may_come=*/true);
  };
  return losses.ok() ? CheckEach(edit_.measurements(), check_measurement) : losses;
}

Status EditCheck::CheckNewValues() {
  return CheckEach(edit_.new_values(), [this](const auto& wish) {
    const auto& [id, offset] = wish;
    Status status = CheckVariableId("SetValues", id, /*may_come=*/true);
    if (!status.ok()) {
      return status;
    }
    const VariableRecord& variable = *See(id).record;
    // No room in the state to write to.
    if (variable.offset < 0) {
      return Invalid("SetValues: " + VariableName(id) +
                     " is a borrowed constant: its values are their owner's to change");
    }
    // Here null is a mistake; for pins and bounds it has a meaning.
    if (offset == GraphEdit::kNoValues) {
      return Invalid("SetValues: " + VariableName(id) + " is given a null pointer");
    }
    return CheckFinite("SetValues: ", "", id, edit_.values().data() + offset,
                       variable.ambient_size);
  });
}

Status EditCheck::CheckPins() {
  return CheckEach(edit_.pins(), [this](const auto& wish) {
    const auto& [id, offset] = wish;
    Status status = CheckVariableId("PinLinearization", id, /*may_come=*/true);
    // Without values the variable is let go of.
    if (status.ok() && offset != GraphEdit::kNoValues) {
      return CheckFinite("PinLinearization: ", "", id, edit_.values().data() + offset,
                         See(id).record->ambient_size);
    }
    return status;
  });
}

Status EditCheck::CheckBounds() {
  return CheckEach(edit_.bounds(), [this](const GraphEdit::NewBounds& bounds) {
    Status status = CheckVariableId("SetBounds", bounds.id, /*may_come=*/true);
    return status.ok() ? CheckOrder(edit_, bounds, See(bounds.id).record->ambient_size) : status;
  });
}

Status EditCheck::CheckGroups() {
  return CheckEach(edit_.elimination_groups(), [this](const auto& wish) {
    const auto& [id, group] = wish;
    Status status = CheckVariableId("SetEliminationGroup", id, /*may_come=*/true);
    if (status.ok() && group < 0) {
      return Invalid("SetEliminationGroup: " + VariableName(id) + " is given the group " +
                     std::to_string(group) + "; groups are 0 or above");
    }
    return status;
  });
}

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
  const internal::EditedGraph edited = {this, &variables_, &factors_, &edits_};
  Status status;
  try {
    internal::EditCheck check(edited, edit, removed);
    status = check.Check();
    if (status.ok()) {
      // Once nothing else may fail.
      internal::PrepareCommit(edited, edit, *removed, check);
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
