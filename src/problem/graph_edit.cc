#include "inceres/problem/graph_edit.h"

#include <algorithm>
#include <string>

#include "problem/find_fault.h"

namespace inceres {

namespace {

// Notes that values were given for a variable that is not there, whose size is not known, so that
// they cannot be kept. Check would come too late: the edit may have added a variable of that id by
// then, for which missing values mean something else (no pin, no bound). The first misuse is kept.
void RequireVariable(const char* call, const FactorGraph& graph, VariableId id, int ambient_size,
                     Status* misuse) {
  if (ambient_size >= 0 || !misuse->ok()) {
    return;
  }
  const bool was_there = id >= 0 && id < graph.num_variables();
  *misuse =
      internal::Invalid(std::string(call) + ": " + internal::VariableName(id) +
                        (was_there ? std::string(" has been removed")
                                   : " does not exist: the graph has " +
                                         std::to_string(graph.num_variables()) + " variables"));
}

}  // namespace

// An edit is a list of wishes. It writes nothing to the graph, but gives out at once the ids that
// Apply is going to use: the k-th new variable of a size takes the k-th id from the back of that
// size's free list, and the next one behind the last when the list is used up. That holds as long
// as no other edit is applied in between, which the revision tells.
//
// Everything passed in is copied, so that the caller's memory may go: values one behind the other,
// with offsets into them, which stay right when the vector moves.

GraphEdit::GraphEdit(const FactorGraph& graph) : graph_(&graph), revision_(graph.revision()) {
}

// As if it were new, on the graph as it is now: ids that it has given out and that were not applied
// are given out again.
void GraphEdit::Restart() {
  revision_ = graph_->revision();
  misuse_ = Status::Ok();
  num_appended_variables_ = 0;
  // Keys stay, with counts of zero: a restarted edit allocates nothing that it has had before.
  for (auto& [size, taken] : reused_variables_) {
    taken = 0;
  }
  for (auto& [family, taken] : places_) {
    taken = {0, 0};
  }
  new_variables_.clear();
  new_factors_.clear();
  factor_variables_.clear();
  values_.clear();
  removed_variables_.clear();
  removed_factors_.clear();
  losses_.clear();
  measurements_.clear();
  constants_.clear();
  new_values_.clear();
  pins_.clear();
  bounds_.clear();
  groups_.clear();
}

// The first misuse is kept: later ones may follow from it. AddFactor writes into the family at once
// and must know that it is the graph's.
bool GraphEdit::Knows(const char* call, FamilyId id, const FactorFamily* given) {
  Status handle = internal::CheckHandle(call, *graph_, id, given);
  if (!handle.ok() && misuse_.ok()) {
    misuse_ = handle;
  }
  return handle.ok();
}

VariableId GraphEdit::NextVariable(int ambient_size, bool borrowed) {
  // How many ids of this size the edit has taken so far.
  int& taken = reused_variables_[{ambient_size, borrowed}];
  const VariableId id = graph_->FreeVariable(ambient_size, borrowed, taken);
  // The list is used up.
  if (id < 0) {
    return graph_->num_variables() + num_appended_variables_++;
  }
  ++taken;
  return id;
}

std::int32_t GraphEdit::NextPlace(FamilyId family) {
  // The same for places: first those of removed factors, then new ones at the end.
  auto& [reused, appended] = places_[family];
  const std::int32_t place = graph_->FreePlace(family, reused);
  if (place < 0) {
    return graph_->NumFactors(family) + appended++;
  }
  ++reused;
  return place;
}

VariableId GraphEdit::AddVariable(const double* values, int ambient_size, Role role,
                                  std::shared_ptr<const Manifold> manifold) {
  const VariableId id = NextVariable(ambient_size, /*borrowed=*/false);
  // A null pointer, or a size that is none, is noted and told by Check, with the id.
  new_variables_.push_back({id, ambient_size, values_.size(), nullptr, /*is_borrowed=*/false,
                            values != nullptr, role, std::move(manifold)});
  if (values != nullptr) {
    // Nothing for a negative size.
    values_.insert(values_.end(), values, values + std::max(ambient_size, 0));
  }
  return id;
}

// Its values stay with their owner; of the address a copy is kept.
VariableId GraphEdit::AddBorrowedConstant(const double* values, int ambient_size) {
  const VariableId id = NextVariable(ambient_size, /*borrowed=*/true);
  new_variables_.push_back({id, ambient_size, values_.size(), values, /*is_borrowed=*/true,
                            values != nullptr, Role::kFrame, nullptr});
  return id;
}

FactorId GraphEdit::Connect(FamilyId family, const VariableId* variables,
                            std::shared_ptr<const Loss> loss) {
  // A wrong id is told by Check, which knows all of the edit.
  const bool known = family >= 0 && family < graph_->num_families();
  // How many variables are read: of an unknown family none.
  const int num_slots = known ? graph_->family(family).num_slots() : 0;
  return Connect(family, variables, static_cast<std::size_t>(num_slots), std::move(loss));
}

FactorId GraphEdit::Connect(FamilyId family, const VariableId* variables, std::size_t num_variables,
                            std::shared_ptr<const Loss> loss) {
  const bool known = family >= 0 && family < graph_->num_families();
  // −1 is refused by Check. The generation tells this factor from those that have had the place,
  // and will.
  FactorId id = {family, known ? NextPlace(family) : -1};
  id.generation = known ? graph_->Generation(family, id.index) : -1;
  new_factors_.push_back({id, factor_variables_.size(), num_variables, std::move(loss)});
  factor_variables_.insert(factor_variables_.end(), variables, variables + num_variables);
  return id;
}

// Of a variable of the graph or of this edit; −1 of an id that neither has.
int GraphEdit::AmbientSize(VariableId id) const {
  if (graph_->HasVariable(id)) {
    return graph_->AmbientSize(id);
  }
  // Values are set soon after the variable is added, if ever: look from the back.
  const auto found = std::find_if(new_variables_.rbegin(), new_variables_.rend(),
                                  [id](const NewVariable& variable) { return variable.id == id; });
  return found == new_variables_.rend() ? -1 : found->ambient_size;
}

// kNoValues for null, and for an id that is not there, of which the size is not known.
std::size_t GraphEdit::Store(VariableId id, const double* values) {
  const int size = AmbientSize(id);
  if (values == nullptr || size < 0) {
    return kNoValues;
  }
  const std::size_t offset = values_.size();
  values_.insert(values_.end(), values, values + size);
  return offset;
}

void GraphEdit::SetValues(VariableId id, const double* values) {
  RequireVariable("SetValues", *graph_, id, AmbientSize(id), &misuse_);
  new_values_.emplace_back(id, Store(id, values));
}

void GraphEdit::PinLinearization(VariableId id, const double* values) {
  RequireVariable("PinLinearization", *graph_, id, AmbientSize(id), &misuse_);
  pins_.emplace_back(id, Store(id, values));
}

void GraphEdit::SetBounds(VariableId id, const double* lower, const double* upper) {
  RequireVariable("SetBounds", *graph_, id, AmbientSize(id), &misuse_);
  const std::size_t low = Store(id, lower);
  bounds_.push_back({id, low, Store(id, upper)});
}

// A misuse counts: an edit that is to be refused is not nothing.
bool GraphEdit::empty() const {
  return misuse_.ok() && new_variables_.empty() && new_factors_.empty() &&
         removed_variables_.empty() && removed_factors_.empty() && losses_.empty() &&
         measurements_.empty() && constants_.empty() && new_values_.empty() && pins_.empty() &&
         bounds_.empty() && groups_.empty();
}

}  // namespace inceres
