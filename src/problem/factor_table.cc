#include <algorithm>
#include <cassert>
#include <utility>

#include "problem/edited_graph.h"

// Factors are columns of variable ids per family, and optional columns of losses. Ids and places
// are indices, so looking up is indexing. Nothing is checked here: Validate, or the check of an
// edit, does so.

namespace inceres::internal {

int FactorTable::num_factors() const {
  int count = 0;
  for (const FamilyRecord& record : records_) {
    // Free places have no factor.
    count += record.num_factors - static_cast<int>(record.free_places.size());
  }
  return count;
}

bool FactorTable::HasFactor(FamilyId id, int factor) const {
  // Marks of an edit are wiped when its check ends, so a place is either taken or free here.
  return Has(id) && factor >= 0 && factor < (*this)[id].num_factors &&
         PlaceOf({id, factor}) == PlaceState::kIncremental;
}

std::int32_t FactorTable::FreePlace(FamilyId id, int k) const {
  const std::vector<std::int32_t>& places = (*this)[id].free_places;
  return IndexOf(k) < places.size() ? places[places.size() - 1 - IndexOf(k)] : -1;
}

// Zero until a factor of the place has been removed.
std::int32_t FactorTable::Generation(FamilyId id, std::int32_t place) const {
  const std::vector<std::int32_t>& generations = (*this)[id].generations;
  return IndexOf(place) < generations.size() ? generations[IndexOf(place)] : 0;
}

FamilyId FactorTable::AddFamily(std::shared_ptr<const FactorFamily> family) {
  records_.emplace_back().family = std::move(family);
  return size() - 1;
}

int FactorTable::Append(FamilyId id, const VariableId* variables,
                        std::shared_ptr<const Loss> loss) {
  FamilyRecord& record = records_[IndexOf(id)];
  const int num_slots = record.family->num_slots();
  for (int s = 0; s < num_slots; ++s) {  // an insertion of the range takes longer
    record.variables.push_back(variables[s]);
  }
  if (loss != nullptr || !record.losses.empty()) {
    // The first loss of the family: the factors before it have none.
    record.losses.resize(IndexOf(record.num_factors));
    record.losses.push_back(std::move(loss));
  }
  // The array of places is kept in step once it is there.
  if (!record.places.empty()) {
    record.places.push_back(PlaceState::kIncremental);
  }
  const int factor = record.num_factors++;
  if (lists_.kept()) {
    lists_.Link(id, record, factor);
  }
  return factor;
}

void FactorTable::TakeOver(FamilyId id, std::vector<VariableId> variables,
                           std::vector<std::shared_ptr<const Loss>> losses) {
  FamilyRecord& record = records_[IndexOf(id)];
  assert(record.num_factors == 0 && !lists_.kept());
  record.num_factors = static_cast<int>(variables.size()) / record.family->num_slots();
  record.variables = std::move(variables);
  record.losses = std::move(losses);
}

// A family without losses has no array for them; the first one makes it.
void FactorTable::SetLoss(FamilyId id, int factor, std::shared_ptr<const Loss> loss) {
  FamilyRecord& record = records_[IndexOf(id)];
  if (loss != nullptr || !record.losses.empty()) {
    record.losses.resize(IndexOf(record.num_factors));
    record.losses[IndexOf(factor)] = std::move(loss);
  }
}

// Also a second time, if a factor named a variable that has come since.
void FactorTable::KeepLists(int num_variables) {
  if (!lists_.kept() || lists_.has_gaps()) {
    lists_.Build(records_, num_variables);
  }
}

PlaceState FactorTable::PlaceOf(FactorId id) const {
  const std::vector<PlaceState>& places = (*this)[id.family].places;
  return IndexOf(id.index) < places.size() ? places[IndexOf(id.index)] : PlaceState::kIncremental;
}

void FactorTable::MarkPlace(FactorId id, PlaceState place) {
  FamilyRecord& record = records_[IndexOf(id.family)];
  const std::size_t size = IndexOf(std::max(record.num_factors, id.index + 1));
  if (record.places.size() < size) {
    record.places.resize(size, PlaceState::kIncremental);
  }
  record.places[IndexOf(id.index)] = place;
}

void FactorTable::ForgetPlacesBeyond(FamilyId id) {
  FamilyRecord& record = records_[IndexOf(id)];
  if (record.places.size() > IndexOf(record.num_factors)) {
    record.places.resize(IndexOf(record.num_factors));
  }
}

void FactorTable::Remove(FactorId id) {
  FamilyRecord& record = records_[IndexOf(id.family)];
  // By the ids in record.variables, which are erased below.
  if (lists_.kept()) {
    lists_.Unlink(id.family, record, id.index);
  }
  const int num_slots = record.family->num_slots();
  // −1: a free place.
  std::fill_n(record.variables.begin() + static_cast<std::ptrdiff_t>(id.index) * num_slots,
              num_slots, -1);
  record.places[IndexOf(id.index)] = PlaceState::kFree;
  // A loss of its own would otherwise live as long as the place is free.
  SetLoss(id.family, id.index, nullptr);
}

// An id from before the removal names another generation, and reaches no factor that is given the
// place.
void FactorTable::Free(FactorId id) {
  FamilyRecord& record = records_[IndexOf(id.family)];
  record.free_places.push_back(id.index);
  ++record.generations[IndexOf(id.index)];
}

void FactorTable::Reuse(FactorId id, const VariableId* variables,
                        std::shared_ptr<const Loss> loss) {
  FamilyRecord& record = records_[IndexOf(id.family)];
  assert(record.free_places.back() == id.index);
  record.free_places.pop_back();
  record.places[IndexOf(id.index)] = PlaceState::kIncremental;
  const auto num_slots = static_cast<std::ptrdiff_t>(record.family->num_slots());
  std::copy_n(variables, num_slots, record.variables.begin() + id.index * num_slots);
  SetLoss(id.family, id.index, std::move(loss));
  if (lists_.kept()) {
    lists_.Link(id.family, record, id.index);
  }
}

void FactorTable::ReserveFree(FamilyId id, std::size_t count) {
  FamilyRecord& record = records_[IndexOf(id)];
  ReserveRoom(&record.free_places, record.free_places.size() + count);
  ReserveRoom(&record.generations, record.places.size());
  // Zeros are what places without an entry count as.
  record.generations.resize(std::max(record.generations.size(), record.places.size()), 0);
}

void FactorTable::ReserveMarked(FamilyId id, bool with_loss) {
  FamilyRecord& record = records_[IndexOf(id)];
  const std::size_t num_places = record.places.size();
  const std::size_t num_entries = num_places * IndexOf(record.family->num_slots());
  ReserveRoom(&record.variables, num_entries);
  lists_.ReserveEntries(id, num_entries);
  if (with_loss || !record.losses.empty()) {
    ReserveLosses(id);
  }
}

// As long as the family, or as far as its places are marked.
void FactorTable::ReserveLosses(FamilyId id) {
  FamilyRecord& record = records_[IndexOf(id)];
  ReserveRoom(&record.losses, std::max(record.places.size(), IndexOf(record.num_factors)));
}

}  // namespace inceres::internal
