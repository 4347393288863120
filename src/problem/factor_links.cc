// The factors of each variable, as doubly linked lists through the slots: a factor joins and leaves
// in O(num_slots), and nothing is allocated but two links a slot.
#include "problem/edit_state.h"

// A link belongs to a slot of a factor (an entry, factor · num_slots + slot) and names the entries
// before and after it in the list of the slot's variable; lists run through all families, the
// factor linked last first. Nothing is kept until someone asks for it (TrackFactors), which costs
// one pass; from then on building and edits keep the lists in step.

namespace inceres {

using internal::FamilyEditState;
using internal::FamilyRecord;
using internal::Link;
using internal::Touch;

namespace {

// in Link::previous: the slot names a variable that was not there
constexpr FamilyId kUnlinked = -2;

}  // namespace

// A slot that named a variable before it was added has no link, so lists are not complete.
bool FactorGraph::TracksFactors() const {
  return edits_->tracked && !edits_->untracked_ids;
}

// FactorId serves as a pair of family and entry here; ForEachFactorOf divides by the number of
// slots.
FactorId FactorGraph::FirstEntryOf(VariableId id) const {
  const Touch& first = edits_->first_touches[Index(id)];
  return {first.family, first.entry};
}

FactorId FactorGraph::NextEntry(FactorId entry) const {
  const Touch& next = edits_->families[Index(entry.family)].links[Index(entry.index)].next;
  return {next.family, next.entry};
}

// Also a second time, if a factor named a variable that has come since.
void FactorGraph::TrackFactors() {
  if (edits_->tracked && !edits_->untracked_ids) {
    return;
  }
  edits_->first_touches.assign(variables_.size(), Touch());
  edits_->untracked_ids = false;
  for (FamilyId id = 0; id < num_families(); ++id) {
    const FamilyRecord& record = families_[Index(id)];
    FamilyEditState& edits = edits_->families[Index(id)];
    edits.links.assign(record.variables.size(), Link());
    for (int factor = 0; factor < record.num_factors; ++factor) {
      // Free places name no variables, and no more do those that the edit under check fills: such a
      // factor joins the lists when it comes.
      const internal::Place place =
          edits.places.empty() ? internal::Place::kIncremental : edits.places[Index(factor)];
      if (place != internal::Place::kFree && place != internal::Place::kComing) {
        LinkFactor(id, factor);
      }
    }
  }
  edits_->tracked = true;
}

void FactorGraph::LinkFactor(FamilyId family, int factor) {
  const FamilyRecord& record = families_[Index(family)];
  std::vector<Link>& links = edits_->families[Index(family)].links;
  const int num_slots = record.family->num_slots();
  // Entries of a factor are contiguous, also in the links.
  for (std::int32_t entry = factor * num_slots; entry < (factor + 1) * num_slots; ++entry) {
    const VariableId id = record.variables[Index(entry)];
    if (id < 0 || id >= num_variables()) {
      // Marked, for UnlinkFactor to pass over it.
      links[Index(entry)].previous.family = kUnlinked;
      edits_->untracked_ids = true;
      continue;
    }
    // In front: O(1), and the entry before has no predecessor any more.
    Touch& first = edits_->first_touches[Index(id)];
    links[Index(entry)] = {Touch(), first};
    if (first.family >= 0) {
      edits_->families[Index(first.family)].links[Index(first.entry)].previous = {family, entry};
    }
    first = {family, entry};
  }
}

void FactorGraph::UnlinkFactor(FamilyId family, int factor) {
  const FamilyRecord& record = families_[Index(family)];
  std::vector<Link>& links = edits_->families[Index(family)].links;
  const int num_slots = record.family->num_slots();
  for (std::int32_t entry = factor * num_slots; entry < (factor + 1) * num_slots; ++entry) {
    const Link link = links[Index(entry)];
    if (link.previous.family == kUnlinked) {
      // It is in no list.
      continue;
    }
    // Without a predecessor it is the head of its variable's list.
    if (link.previous.family >= 0) {
      edits_->families[Index(link.previous.family)].links[Index(link.previous.entry)].next =
          link.next;
    } else {
      edits_->first_touches[Index(record.variables[Index(entry)])] = link.next;
    }
    if (link.next.family >= 0) {
      edits_->families[Index(link.next.family)].links[Index(link.next.entry)].previous =
          link.previous;
    }
  }
}

}  // namespace inceres
