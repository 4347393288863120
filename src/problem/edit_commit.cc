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
// free lists; they are taken off here in the same order, which the assertions look at.

namespace internal {
namespace {

// As push_back grows: a plain reserve would move everything at each edit.
template <typename T>
void ReserveRoom(std::vector<T>* values, std::size_t size) {
  if (values->capacity() < size) {
    // Twice as much, so that a graph that grows by edits moves its arrays as seldom as one that
    // grows by itself.
    values->reserve(std::max(size, 2 * values->capacity()));
  }
}

}  // namespace

void EditCheck::ReserveVariables() const {
  // As if all were appended: those that take the id of a removed one need less.
  const std::size_t num_variables = graph_.variables_.size() + edit_.new_variables().size();
  ReserveRoom(&graph_.variables_, num_variables);
  ReserveRoom(&graph_.state_, graph_.state_.size() + edit_.values().size());
  // One list head a variable, only where lists are kept.
  if (edits_.tracked) {
    ReserveRoom(&edits_.first_touches, num_variables);
  }
  for (const VariableId id : edit_.removed_variables()) {
    const VariableRecord& variable = graph_.variables_[Graph::Index(id)];
    // Makes the list if it is the first of this size: Commit looks it up without making any.
    std::vector<VariableId>& ids =
        edits_.free_variables[FreeKey(variable.ambient_size, variable.offset < 0)];
    ReserveRoom(&ids, ids.size() + edit_.removed_variables().size());
  }
}

void EditCheck::ReserveFactors() const {
  for (const FactorId id : removed_) {
    // As many as go at all, for each family: more than needed, and no counting.
    std::vector<std::int32_t>& places = graph_.families_[Graph::Index(id.family)].free_places;
    ReserveRoom(&places, places.size() + removed_.size());
    FamilyEditState& edits = edits_.families[Graph::Index(id.family)];
    ReserveRoom(&edits.generations, edits.places.size());
    // Zeros are what places without an entry count as.
    edits.generations.resize(std::max(edits.generations.size(), edits.places.size()), 0);
  }
  for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
    FamilyRecord& record = graph_.families_[Graph::Index(factor.id.family)];
    FamilyEditState& edits = edits_.families[Graph::Index(factor.id.family)];
    const std::size_t num_places = edits.places.size();  // those that come included
    const std::size_t num_entries = num_places * Graph::Index(record.family->num_slots());
    ReserveRoom(&record.variables, num_entries);
    // A family without losses has no array of them; the first one makes it, as long as the family.
    if (factor.loss != nullptr || !record.losses.empty()) {
      ReserveRoom(&record.losses, num_places);
    }
    if (edits_.tracked) {
      ReserveRoom(&edits.links, num_entries);
    }
  }
  for (const auto& [id, loss] : edit_.losses()) {
    FamilyRecord& record = graph_.families_[Graph::Index(id.family)];
    if (loss != nullptr || !record.losses.empty()) {
      const std::size_t num_places = edits_.families[Graph::Index(id.family)].places.size();
      // The array of places may not exist where only losses are set.
      ReserveRoom(&record.losses, std::max(num_places, Graph::Index(record.num_factors)));
    }
  }
}

// The last word on each variable: a later entry writes over an earlier one, or takes it away.
void EditCheck::PreparePins() const {
  for (const auto& [id, offset] : edit_.pins()) {
    if (offset == GraphEdit::kNoValues) {
      edits_.coming_pins.erase(id);
    } else {
      const double* values = edit_.values().data() + offset;
      edits_.coming_pins[id].assign(values, values + See(id).record->ambient_size);
    }
  }
}

void EditCheck::PrepareBounds() const {
  const auto values = [this](std::size_t offset) {
    return offset == GraphEdit::kNoValues ? nullptr : edit_.values().data() + offset;
  };
  for (const GraphEdit::NewBounds& bounds : edit_.bounds()) {
    VariableBounds made;
    if (MakeBounds(values(bounds.lower), values(bounds.upper), See(bounds.id).record->ambient_size,
                   &made)) {
      edits_.coming_bounds[bounds.id] = std::move(made);
    } else {
      edits_.coming_bounds.erase(bounds.id);
    }
  }
}

void EditCheck::PlaceMeasurements(FactorGraph* graph, const GraphEdit& edit) {
  EditState& edits = *graph->edits_;
  if (edits.measurements_placed) {
    return;
  }
  for (const auto& [id, place] : edit.measurements()) {
    // Null: the caller has written to his family himself.
    if (place != nullptr) {
      place();
    }
  }
  edits.measurements_placed = true;
}

/// Carries out one checked edit, in the order that GraphEdit documents. What is freed enters the
/// free lists last: the edit's own ids were taken from them as they were before.
class EditCommit {
 public:
  EditCommit(FactorGraph* graph, const GraphEdit& edit, const std::vector<FactorId>& removed)
      : graph_(*graph), edits_(*graph->edits_), edit_(edit), removed_(removed) {}

  // What goes first: its ids and places are still named by the factors that go, and unlinked from
  // their lists while they are.
  void Run() {
    // What this throws is the user's, and passes through while the graph is as it was. A factor
    // that comes has its place in the family already.
    EditCheck::PlaceMeasurements(&graph_, edit_);
    std::for_each(removed_.begin(), removed_.end(), [this](FactorId id) { RemoveFactor(id); });
    for (const VariableId id : edit_.removed_variables()) {
      RemoveVariable(id);
    }
    for (const GraphEdit::NewVariable& variable : edit_.new_variables()) {
      AddVariable(variable);
    }
    for (const GraphEdit::NewFactor& factor : edit_.new_factors()) {
      AddFactor(factor);
    }
    Settle();
    Free();
    edits_.measurements_placed = false;
    ++graph_.revision_;
  }

 private:
  using Graph = FactorGraph;

  void RemoveFactor(FactorId id) {
    FamilyRecord& record = graph_.families_[Graph::Index(id.family)];
    // By the ids in record.variables, which are erased below.
    if (edits_.tracked) {
      graph_.UnlinkFactor(id.family, id.index);
    }
    const int num_slots = record.family->num_slots();
    // −1: a free place.
    std::fill_n(record.variables.begin() + static_cast<std::ptrdiff_t>(id.index) * num_slots,
                num_slots, -1);
    edits_.families[Graph::Index(id.family)].places[Graph::Index(id.index)] = Place::kFree;
    // A loss of its own would otherwise live as long as the place is free.
    graph_.SetLoss(id.family, id.index, nullptr);
  }

  // The room keeps zeros, so that a look for values that are not finite may run over all of the
  // state.
  void RemoveVariable(VariableId id) {
    VariableRecord& variable = graph_.variables_[Graph::Index(id)];
    if (variable.offset >= 0) {
      std::fill_n(graph_.state_.begin() + variable.offset, variable.ambient_size, 0.0);
    }
    variable.borrowed = nullptr;
    variable.manifold = nullptr;
    // A constant frame of no dimension: what meets it by mistake moves nothing. The size stays, by
    // which its id is found again, and so does the offset of its room.
    variable.tangent_size = 0;
    variable.role = Role::kFrame;
    variable.constant = true;
    variable.removed = true;
    graph_.SetEliminationGroup(id, 0);
    graph_.bounds_.erase(id);
    graph_.pins_.erase(id);
    ++graph_.num_removed_variables_;
  }

  // Appended, or in the place of a removed variable of the same size, whose room in the state it
  // takes over.
  void AddVariable(const GraphEdit::NewVariable& added) {
    VariableRecord record = added.is_borrowed
                                ? MakeBorrowed(added.borrowed, added.ambient_size)
                                : MakeOwned(added.ambient_size, added.role, added.manifold);
    const double* values = edit_.values().data() + added.values;
    if (added.id == graph_.num_variables()) {
      graph_.AppendVariable(std::move(record), values);
      return;
    }
    VariableRecord& variable = graph_.variables_[Graph::Index(added.id)];
    std::vector<VariableId>& ids =
        edits_.free_variables.at(FreeKey(added.ambient_size, added.is_borrowed));
    // The edit has taken ids from the back, one after the other.
    assert(variable.removed && ids.back() == added.id);
    ids.pop_back();
    --graph_.num_removed_variables_;
    record.offset = variable.offset;
    // Values last: SetValues writes to where the record says.
    variable = std::move(record);
    graph_.SetValues(added.id, values);
  }

  // Its measurement is in the family already.
  void AddFactor(const GraphEdit::NewFactor& added) {
    const VariableId* ids = edit_.factor_variables().data() + added.variables;
    FamilyRecord& record = graph_.families_[Graph::Index(added.id.family)];
    // Behind the last place: AppendFactor keeps all parallel arrays in step.
    if (added.id.index == record.num_factors) {
      graph_.AppendFactor(added.id.family, ids, added.loss);
      return;
    }
    assert(record.free_places.back() == added.id.index);
    record.free_places.pop_back();
    edits_.families[Graph::Index(added.id.family)].places[Graph::Index(added.id.index)] =
        Place::kIncremental;
    const auto num_slots = static_cast<std::ptrdiff_t>(added.num_variables);
    std::copy_n(ids, num_slots, record.variables.begin() + added.id.index * num_slots);
    graph_.SetLoss(added.id.family, added.id.index, added.loss);
    if (edits_.tracked) {
      graph_.LinkFactor(added.id.family, added.id.index);
    }
  }

  // In the order that GraphEdit documents, measurements aside, which nothing here looks at; each
  // list in the order of the calls: of two for the same variable the later one holds.
  void Settle() {
    for (const auto& [id, loss] : edit_.losses()) {
      graph_.SetLoss(id.family, id.index, loss);
    }
    for (const auto& [id, constant] : edit_.constants()) {
      graph_.SetConstant(id, constant);
    }
    for (const auto& [id, offset] : edit_.new_values()) {
      graph_.SetValues(id, edit_.values().data() + offset);
    }
    // What was there goes, so that every prepared node finds its place free: the nodes are moved,
    // which allocates nothing.
    for (const auto& [id, offset] : edit_.pins()) {
      graph_.pins_.erase(id);
    }
    graph_.pins_.merge(edits_.coming_pins);
    for (const GraphEdit::NewBounds& bounds : edit_.bounds()) {
      graph_.bounds_.erase(bounds.id);
    }
    graph_.bounds_.merge(edits_.coming_bounds);
    for (const auto& [id, group] : edit_.elimination_groups()) {
      graph_.SetEliminationGroup(id, group);
    }
  }

  // After everything has come: what this edit frees is for the next one, whose ids are given out in
  // view of these lists.
  void Free() {
    for (const FactorId id : removed_) {
      graph_.families_[Graph::Index(id.family)].free_places.push_back(id.index);
      // An id from before the removal names another generation, and reaches no factor that is given
      // the place.
      ++edits_.families[Graph::Index(id.family)].generations[Graph::Index(id.index)];
    }
    for (const VariableId id : edit_.removed_variables()) {
      const VariableRecord& variable = graph_.variables_[Graph::Index(id)];
      edits_.free_variables.at(FreeKey(variable.ambient_size, variable.offset < 0)).push_back(id);
    }
  }

  Graph& graph_;
  EditState& edits_;
  const GraphEdit& edit_;
  const std::vector<FactorId>& removed_;
};

}  // namespace internal

void FactorGraph::Commit(const GraphEdit& edit, const std::vector<FactorId>& removed) {
  assert(&edit.graph() == this && edit.revision() == revision_);
  internal::EditCommit(this, edit, removed).Run();
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
