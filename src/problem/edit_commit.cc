// Room for an edit, made while it may still fail, and the edit itself, which then cannot: but for
// what a family of the user's throws, before anything is changed.
#include <algorithm>
#include <cassert>

#include "problem/edit_check.h"

namespace inceres {

// The second half of a transaction. Check has found nothing wrong, and has made room in every
// vector that grows here, by as much as it grows: push_back and insert do not allocate, so nothing
// is left half done for want of memory in them. Pins and bounds are nodes of maps: Check makes
// them, and here they change hands. Ids and places were given out by GraphEdit from the ends of the
// free lists; they are taken off here in the same order, which the tables assert.

namespace internal {
namespace {

void ReserveFactors(FactorTable* factors, const GraphEdit& edit,
                    const std::vector<FactorId>& removed) {
  for (const FactorId id : removed) {
    // As many as go at all, for each family: more than needed, and no counting.
    factors->ReserveFree(id.family, removed.size());
  }
  for (const GraphEdit::NewFactor& factor : edit.new_factors()) {
    factors->ReserveMarked(factor.id.family, factor.loss != nullptr);
  }
  for (const auto& [id, loss] : edit.losses()) {
    if (loss != nullptr || !(*factors)[id.family].losses.empty()) {
      factors->ReserveLosses(id.family);
    }
  }
}

// The last word on each variable: a later entry writes over an earlier one, or takes it away.
void PreparePins(const GraphEdit& edit, const EditCheck& check, EditState* prepared) {
  prepared->coming_pins.clear();
  for (const auto& [id, offset] : edit.pins()) {
    if (offset == GraphEdit::kNoValues) {
      prepared->coming_pins.erase(id);
    } else {
      const double* values = edit.values().data() + offset;
      prepared->coming_pins[id].assign(values, values + check.See(id).record->ambient_size);
    }
  }
}

void PrepareBounds(const GraphEdit& edit, const EditCheck& check, EditState* prepared) {
  prepared->coming_bounds.clear();
  const auto values = [&edit](std::size_t offset) {
    return offset == GraphEdit::kNoValues ? nullptr : edit.values().data() + offset;
  };
  for (const GraphEdit::NewBounds& bounds : edit.bounds()) {
    VariableBounds made;
    if (MakeBounds(values(bounds.lower), values(bounds.upper),
                   check.See(bounds.id).record->ambient_size, &made)) {
      prepared->coming_bounds[bounds.id] = std::move(made);
    } else {
      prepared->coming_bounds.erase(bounds.id);
    }
  }
}

}  // namespace

void PrepareCommit(const EditedGraph& graph, const GraphEdit& edit,
                   const std::vector<FactorId>& removed, const EditCheck& check) {
  graph.scratch->measurements_placed = false;
  // As if all were appended: those that take the id of a removed one need less.
  const std::size_t num_new = edit.new_variables().size();
  graph.variables->ReserveFor(num_new, edit.values().size(), edit.removed_variables());
  graph.factors->ReserveVariables(IndexOf(graph.variables->size()) + num_new);
  ReserveFactors(graph.factors, edit, removed);
  PreparePins(edit, check, graph.scratch);
  PrepareBounds(edit, check, graph.scratch);
}

namespace {

// Appended, or in the place of a removed one. A factor's measurement is in its family already.
void AddComers(const EditedGraph& graph, const GraphEdit& edit) {
  for (const GraphEdit::NewVariable& added : edit.new_variables()) {
    const double* values = edit.values().data() + added.values;
    if (added.id == graph.variables->size()) {
      graph.variables->Append(RecordOf(added), values);
      graph.factors->AddVariable();
    } else {
      graph.variables->Reuse(added.id, RecordOf(added), values);
    }
  }
  for (const GraphEdit::NewFactor& added : edit.new_factors()) {
    const VariableId* ids = edit.factor_variables().data() + added.variables;
    if (added.id.index == (*graph.factors)[added.id.family].num_factors) {
      graph.factors->Append(added.id.family, ids, added.loss);
    } else {
      graph.factors->Reuse(added.id, ids, added.loss);
    }
  }
}

// In the order that GraphEdit documents, measurements aside, which nothing here looks at; each list
// in the order of the calls: of two for the same variable the later one holds.
void Settle(const EditedGraph& graph, const GraphEdit& edit) {
  for (const auto& [id, loss] : edit.losses()) {
    graph.factors->SetLoss(id.family, id.index, loss);
  }
  for (const auto& [id, constant] : edit.constants()) {
    graph.variables->SetConstant(id, constant);
  }
  for (const auto& [id, offset] : edit.new_values()) {
    graph.variables->SetValues(id, edit.values().data() + offset);
  }
  // What was there goes, so that every prepared node finds its place free.
  for (const auto& [id, offset] : edit.pins()) {
    graph.variables->Pin(id, nullptr);
  }
  graph.variables->TakePins(&graph.scratch->coming_pins);
  for (const GraphEdit::NewBounds& bounds : edit.bounds()) {
    graph.variables->DropBounds(bounds.id);
  }
  graph.variables->TakeBounds(&graph.scratch->coming_bounds);
  for (const auto& [id, group] : edit.elimination_groups()) {
    graph.variables->SetGroup(id, group);
  }
}

}  // namespace
}  // namespace internal

void FactorGraph::PlaceMeasurements(const GraphEdit& edit) {
  if (edits_.measurements_placed) {
    return;
  }
  for (const auto& [id, place] : edit.measurements()) {
    // Null: the caller has written to his family himself.
    if (place != nullptr) {
      place();
    }
  }
  edits_.measurements_placed = true;
}

// What goes first: its ids and places are still named by the factors that go, and unlinked from
// their lists while they are. What is freed enters the free lists last: the edit's own ids were
// taken from them as they were before.
void FactorGraph::Commit(const GraphEdit& edit, const std::vector<FactorId>& removed) {
  assert(&edit.graph() == this && edit.revision() == revision());
  // What this throws is the user's, and passes through while the graph is as it was.
  PlaceMeasurements(edit);
  const std::vector<VariableId>& gone = edit.removed_variables();
  std::for_each(removed.begin(), removed.end(), [this](FactorId id) { factors_.Remove(id); });
  std::for_each(gone.begin(), gone.end(), [this](VariableId id) { variables_.Remove(id); });
  const internal::EditedGraph edited = {this, &variables_, &factors_, &edits_};
  internal::AddComers(edited, edit);
  internal::Settle(edited, edit);
  std::for_each(removed.begin(), removed.end(), [this](FactorId id) { factors_.Free(id); });
  std::for_each(gone.begin(), gone.end(), [this](VariableId id) { variables_.Free(id); });
  edits_.measurements_placed = false;
  ++revision_;
}

// For graphs without a solver; one that has a solver goes through IncrementalSolver::Apply, which
// must hear of the changes.
Status FactorGraph::Apply(const GraphEdit& edit) {
  std::vector<FactorId> removed;
  Status status = Check(edit, &removed);
  if (status.ok()) {
    Commit(edit, removed);
  }
  return status;
}

}  // namespace inceres
