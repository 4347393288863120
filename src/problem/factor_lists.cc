#include "problem/edited_graph.h"

// A link belongs to a slot of a factor (an entry, factor · num_slots + slot) and names the entries
// before and after it in the list of the slot's variable; lists run through all families, the
// factor linked last first. Building them costs one pass over the factors; from then on building
// and edits keep them in step, and nothing is allocated but two links a slot.

namespace inceres::internal {
namespace {

// as the family of a previous touch: the slot names a variable that was not there
constexpr FamilyId kUnlinked = -2;

}  // namespace

void FactorLists::Build(const std::vector<FamilyRecord>& families, int num_variables) {
  first_.assign(IndexOf(num_variables), Touch());
  links_.assign(families.size(), {});
  kept_ = true;
  has_gaps_ = false;
  for (FamilyId id = 0; IndexOf(id) < families.size(); ++id) {
    const FamilyRecord& family = families[IndexOf(id)];
    links_[IndexOf(id)].resize(family.variables.size());
    for (int factor = 0; factor < family.num_factors; ++factor) {
      // Free places name no variables, and no more do those that the edit under check fills: such a
      // factor joins the lists when it comes.
      const PlaceState place =
          family.places.empty() ? PlaceState::kIncremental : family.places[IndexOf(factor)];
      if (place != PlaceState::kFree && place != PlaceState::kComing) {
        Link(id, family, factor);
      }
    }
  }
}

// One list head per variable, once lists are kept.
void FactorLists::AddVariable() {
  if (kept_) {
    first_.emplace_back();
  }
}

void FactorLists::Link(FamilyId id, const FamilyRecord& family, int factor) {
  if (links_.size() <= IndexOf(id)) {
    links_.resize(IndexOf(id) + 1);
  }
  std::vector<LinkPair>& links = links_[IndexOf(id)];
  links.resize(family.variables.size());
  const int num_slots = family.family->num_slots();
  // Entries of a factor are contiguous, also in the links.
  for (std::int32_t entry = factor * num_slots; entry < (factor + 1) * num_slots; ++entry) {
    const VariableId variable = family.variables[IndexOf(entry)];
    if (variable < 0 || IndexOf(variable) >= first_.size()) {
      // Marked, for Unlink to pass over it.
      links[IndexOf(entry)].previous.family = kUnlinked;
      has_gaps_ = true;
      continue;
    }
    // In front: O(1), and the entry before has no predecessor any more.
    Touch& first = first_[IndexOf(variable)];
    links[IndexOf(entry)] = {Touch(), first};
    if (first.family >= 0) {
      links_[IndexOf(first.family)][IndexOf(first.entry)].previous = {id, entry};
    }
    first = {id, entry};
  }
}

void FactorLists::Unlink(FamilyId id, const FamilyRecord& family, int factor) {
  const int num_slots = family.family->num_slots();
  for (std::int32_t entry = factor * num_slots; entry < (factor + 1) * num_slots; ++entry) {
    const LinkPair link = links_[IndexOf(id)][IndexOf(entry)];
    if (link.previous.family == kUnlinked) {
      // It is in no list.
      continue;
    }
    // Without a predecessor it is the head of its variable's list.
    if (link.previous.family >= 0) {
      links_[IndexOf(link.previous.family)][IndexOf(link.previous.entry)].next = link.next;
    } else {
      first_[IndexOf(family.variables[IndexOf(entry)])] = link.next;
    }
    if (link.next.family >= 0) {
      links_[IndexOf(link.next.family)][IndexOf(link.next.entry)].previous = link.previous;
    }
  }
}

void FactorLists::ReserveVariables(std::size_t size) {
  if (kept_) {
    ReserveRoom(&first_, size);
  }
}

void FactorLists::ReserveEntries(FamilyId id, std::size_t size) {
  if (kept_) {
    links_.resize(std::max(links_.size(), IndexOf(id) + 1));
    ReserveRoom(&links_[IndexOf(id)], size);
  }
}

}  // namespace inceres::internal
