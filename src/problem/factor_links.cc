// The factors of each variable, as doubly linked lists through the slots: a factor joins and leaves in O(num_slots), and nothing
// is allocated but two links a slot.
#include "inceres/problem/factor_graph.h"

namespace inceres {
namespace {

constexpr FamilyId kUnlinked = -2;  // in Link::previous: the slot names a variable that was not there

}  // namespace

void FactorGraph::TrackFactors() {
  if (tracked_ && !untracked_ids_) {
    return;
  }
  first_touches_.assign(variables_.size(), Touch());
  untracked_ids_ = false;
  for (FamilyId id = 0; id < num_families(); ++id) {
    FamilyRecord& record = families_[Index(id)];
    record.links.assign(record.variables.size(), Link());
    for (int factor = 0; factor < record.num_factors; ++factor) {
      if (record.places.empty() || record.places[Index(factor)] != Place::kFree) {
        LinkFactor(id, factor);
      }
    }
  }
  tracked_ = true;
}

void FactorGraph::LinkFactor(FamilyId family, int factor) {
  FamilyRecord& record = families_[Index(family)];
  const int num_slots = record.family->num_slots();
  for (std::int32_t entry = factor * num_slots; entry < (factor + 1) * num_slots; ++entry) {
    const VariableId id = record.variables[Index(entry)];
    if (id < 0 || id >= num_variables()) {
      record.links[Index(entry)].previous.family = kUnlinked;
      untracked_ids_ = true;
      continue;
    }
    Touch& first = first_touches_[Index(id)];
    record.links[Index(entry)] = {Touch(), first};
    if (first.family >= 0) {
      families_[Index(first.family)].links[Index(first.entry)].previous = {family, entry};
    }
    first = {family, entry};
  }
}

void FactorGraph::UnlinkFactor(FamilyId family, int factor) {
  const FamilyRecord& record = families_[Index(family)];
  const int num_slots = record.family->num_slots();
  for (std::int32_t entry = factor * num_slots; entry < (factor + 1) * num_slots; ++entry) {
    const Link link = record.links[Index(entry)];
    if (link.previous.family == kUnlinked) {
      continue;
    }
    if (link.previous.family >= 0) {
      families_[Index(link.previous.family)].links[Index(link.previous.entry)].next = link.next;
    } else {
      first_touches_[Index(record.variables[Index(entry)])] = link.next;
    }
    if (link.next.family >= 0) {
      families_[Index(link.next.family)].links[Index(link.next.entry)].previous = link.previous;
    }
  }
}

}  // namespace inceres
