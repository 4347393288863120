#include "inceres/problem/factor_graph.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <string>
#include <utility>

#include "problem/edit_state.h"
#include "problem/find_fault.h"

// How a graph is built up and read. Variables are records, and the values of all that are not
// borrowed lie in one array, the state, at an offset each: solvers copy and move all of them at
// once. Factors are columns of variable ids per family, and optional columns of losses. Ids and
// places are indices, so looking up is indexing.
//
// Building reports nothing. What can still be stored is stored, wrong or not, and Validate, which
// every solve calls, names the first culprit; what cannot be stored is remembered as misuse.

namespace inceres {

using internal::FamilyName;
using internal::Invalid;

namespace {

// The first few ids: a factor may have been given thousands.
std::string CountAndList(const std::vector<VariableId>& variables) {
  constexpr std::size_t kMaxListed = 8;
  std::string text =
      std::to_string(variables.size()) + (variables.size() == 1 ? " variable" : " variables");
  for (std::size_t i = 0; i < std::min(variables.size(), kMaxListed); ++i) {
    text += (i == 0 ? " (" : ", ") + std::to_string(variables[i]);
  }
  return text + (variables.empty() ? "" : variables.size() > kMaxListed ? ", …)" : ")");
}

// "2 slots (of 9, 3 values)".
std::string DescribeSlots(const FactorFamily& family) {
  std::string text =
      std::to_string(family.num_slots()) + (family.num_slots() == 1 ? " slot" : " slots");
  for (int s = 0; s < family.num_slots(); ++s) {
    text += (s == 0 ? " (of " : ", ") + std::to_string(family.slot(s).ambient_size);
  }
  return text + (family.num_slots() == 0 ? "" : " values)");
}

}  // namespace

namespace internal {

// Records for both ways in, building and edits. An offset of −1 means borrowed.
VariableRecord MakeOwned(int ambient_size, Role role, std::shared_ptr<const Manifold> manifold) {
  VariableRecord variable;
  variable.ambient_size = ambient_size;
  variable.tangent_size = manifold == nullptr ? ambient_size : manifold->TangentSize();
  variable.role = role;
  variable.manifold = std::move(manifold);
  return variable;
}

// Borrowed values have tangent size 0, so that nothing can move them, whatever SetConstant says.
VariableRecord MakeBorrowed(const double* values, int ambient_size) {
  VariableRecord variable;
  variable.offset = -1;
  variable.borrowed = values;
  variable.ambient_size = ambient_size;
  variable.constant = true;
  return variable;
}

// Bounds of ∓infinity, or of ∓the largest double as in Ceres, are none.
bool MakeBounds(const double* lower, const double* upper, int size, VariableBounds* bounds) {
  constexpr double kMax = std::numeric_limits<double>::max();
  const auto count = static_cast<std::size_t>(size);
  const auto take = [count](const double* values, double none) {
    return values != nullptr ? std::vector<double>(values, values + count)
                             : std::vector<double>(count, none);
  };
  bounds->lower = take(lower, -kMax);
  bounds->upper = take(upper, kMax);
  // A NaN stays, for Validate() to find.
  return std::any_of(bounds->lower.begin(), bounds->lower.end(),
                     [](double b) { return !(b <= -kMax); }) ||
         std::any_of(bounds->upper.begin(), bounds->upper.end(),
                     [](double b) { return !(b >= kMax); });
}

EditStateOwner::EditStateOwner() : state_(std::make_unique<EditState>()) {
}
// A copy of a graph has an edit state of its own, marks and lists included: edits are begun on one
// graph.
EditStateOwner::EditStateOwner(const EditStateOwner& other)
    : state_(std::make_unique<EditState>(*other.state_)) {
}
EditStateOwner::EditStateOwner(EditStateOwner&& other) noexcept = default;
EditStateOwner& EditStateOwner::operator=(const EditStateOwner& other) {
  state_ = std::make_unique<EditState>(*other.state_);
  return *this;
}
EditStateOwner& EditStateOwner::operator=(EditStateOwner&& other) noexcept = default;
EditStateOwner::~EditStateOwner() = default;

}  // namespace internal

// For AddVariable and for edits: the revision is the callers' to count, since an edit counts as one
// change.
VariableId FactorGraph::AppendVariable(internal::VariableRecord variable, const double* values) {
  if (variable.offset >= 0) {
    variable.offset = static_cast<std::int64_t>(state_.size());
    const std::size_t num_values = static_cast<std::size_t>(std::max(variable.ambient_size, 0));
    if (values != nullptr) {
      state_.insert(state_.end(), values, values + num_values);
    } else {
      // Nothing is checked here: Validate() finds the NaN and names the variable.
      state_.insert(state_.end(), num_values, std::numeric_limits<double>::quiet_NaN());
    }
  }
  variables_.push_back(std::move(variable));
  // One list head per variable, once lists of factors are kept.
  if (edits_->tracked) {
    edits_->first_touches.emplace_back();
  }
  return num_variables() - 1;
}

VariableId FactorGraph::AddVariable(const double* values, int ambient_size, Role role,
                                    std::shared_ptr<const Manifold> manifold) {
  // Edits that were begun before are then refused.
  ++revision_;
  return AppendVariable(internal::MakeOwned(ambient_size, role, std::move(manifold)), values);
}

void FactorGraph::SetEliminationGroup(VariableId id, int group) {
  std::int32_t& now = variables_[Index(id)].group;
  num_grouped_ += (group != 0 ? 1 : 0) - (now != 0 ? 1 : 0);
  now = group;
}

VariableId FactorGraph::AddBorrowedConstant(const double* values, int ambient_size) {
  ++revision_;
  return AppendVariable(internal::MakeBorrowed(values, ambient_size), nullptr);
}

FamilyId FactorGraph::AddFamily(std::shared_ptr<const FactorFamily> family) {
  if (family == nullptr) {
    Misused("AddFamily: the family is a null pointer");
    return -1;
  }
  ++revision_;
  families_.emplace_back().family = std::move(family);
  // At the same index as the family.
  edits_->families.emplace_back();
  return num_families() - 1;
}

// False, so that callers can return it.
// The first misuse is kept: later ones may follow from it.
bool FactorGraph::Misused(std::string message) {
  if (misuse_.ok()) {
    misuse_ = Invalid(std::move(message));
  }
  return false;
}

bool FactorGraph::HasFamily(const char* call, FamilyId id) {
  return (id >= 0 && id < num_families()) || Misused(internal::NoFamily(call, *this, id));
}

// Before AddFactor adds the measurement: a family must not hold more measurements than factors.
bool FactorGraph::CanAddFactor(FamilyId id, const FactorFamily* given,
                               const std::vector<VariableId>& variables) {
  Status handle = internal::CheckHandle("AddFactor", *this, id, given);
  if (!handle.ok()) {
    return Misused(std::move(handle.message));
  }
  return variables.size() == Index(given->num_slots()) ||
         Misused("AddFactor: a factor of " + FamilyName(id, *given) + " is given " +
                 CountAndList(variables) + " but has " + DescribeSlots(*given));
}

int FactorGraph::Connect(FamilyId family, const VariableId* variables,
                         std::shared_ptr<const Loss> loss) {
  if (!HasFamily("Connect", family)) {
    return -1;
  }
  ++revision_;
  return AppendFactor(family, variables, std::move(loss));
}

// Takes the caller's vectors as they are when the family is empty. With factors there, or with
// lists to keep, it is the same as Connect one by one.
void FactorGraph::ConnectMany(FamilyId family, std::vector<VariableId> variables,
                              std::vector<std::shared_ptr<const Loss>> losses) {
  if (variables.empty() || !HasFamily("ConnectMany", family)) {
    return;
  }
  internal::FamilyRecord& record = families_[Index(family)];
  const std::size_t num_slots = Index(record.family->num_slots());
  // Without slots no number of variables fits.
  const std::size_t count = num_slots == 0 ? 0 : variables.size() / num_slots;
  if (count * num_slots != variables.size()) {
    Misused("ConnectMany: factors of " + FamilyName(family, *record.family) + " have " +
            DescribeSlots(*record.family) + ", and " + std::to_string(variables.size()) +
            " variables are not so many each");
    return;
  }
  if (!losses.empty() && losses.size() != count) {
    Misused("ConnectMany: " + std::to_string(count) + " factors of " +
            FamilyName(family, *record.family) + " are given " + std::to_string(losses.size()) +
            " losses");
    return;
  }
  if (record.num_factors > 0 || edits_->tracked) {
    for (std::size_t i = 0; i < count; ++i) {
      Connect(family, variables.data() + i * num_slots,
              losses.empty() ? nullptr : std::move(losses[i]));
    }
    return;
  }
  ++revision_;
  record.variables = std::move(variables);
  record.losses = std::move(losses);
  record.num_factors = static_cast<int>(count);
}

// For Connect and for edits, without checks of the ids: Validate or the edit's check has them.
int FactorGraph::AppendFactor(FamilyId family, const VariableId* variables,
                              std::shared_ptr<const Loss> loss) {
  internal::FamilyRecord& record = families_[Index(family)];
  const int num_slots = record.family->num_slots();
  for (int s = 0; s < num_slots; ++s) {  // an insertion of the range takes longer
    record.variables.push_back(variables[s]);
  }
  if (loss != nullptr || !record.losses.empty()) {
    record.losses.resize(Index(
        record.num_factors));  // the first loss of the family: the factors before it have none
    record.losses.push_back(std::move(loss));
  }
  internal::FamilyEditState& edits = edits_->families[Index(family)];
  // An array of places exists once an edit has looked at the family; it is kept in step with the
  // factors.
  if (!edits.places.empty()) {
    edits.places.push_back(internal::Place::kIncremental);
  }
  const int factor = record.num_factors++;
  // Links are parallel to the variables of the family; the factor enters the lists of its
  // variables.
  if (edits_->tracked) {
    edits.links.resize(record.variables.size());
    LinkFactor(family, factor);
  }
  return factor;
}

// A family without losses has no array for them; the first one makes it.
void FactorGraph::SetLoss(FamilyId family, int factor, std::shared_ptr<const Loss> loss) {
  internal::FamilyRecord& record = families_[Index(family)];
  if (loss != nullptr || !record.losses.empty()) {
    record.losses.resize(Index(record.num_factors));
    record.losses[Index(factor)] = std::move(loss);
  }
}

// A variable with nothing but bounds that are none is not bounded.
void FactorGraph::SetBounds(VariableId id, const double* lower, const double* upper) {
  assert(id >= 0 && id < num_variables() && "FactorGraph::SetBounds: no such variable");
  VariableBounds bounds;
  if (internal::MakeBounds(lower, upper, AmbientSize(id), &bounds)) {
    bounds_[id] = std::move(bounds);
  } else {
    bounds_.erase(id);
  }
}

// In a map, for few are pinned: a graph without pins pays nothing for them.
void FactorGraph::PinLinearization(VariableId id, const double* values) {
  assert(id >= 0 && id < num_variables() && "FactorGraph::PinLinearization: no such variable");
  if (values == nullptr) {
    pins_.erase(id);
  } else {
    pins_[id].assign(values, values + AmbientSize(id));
  }
}

void FactorGraph::SetValues(VariableId id, const double* values) {
  const internal::VariableRecord& variable = variables_[Index(id)];
  // Borrowed values are their owner's: nothing is written there.
  if (variable.offset >= 0) {
    std::copy_n(values, variable.ambient_size, state_.begin() + variable.offset);
  }
}

void FactorGraph::Reserve(int num_variables, int num_values) {
  variables_.reserve(Index(num_variables));
  state_.reserve(Index(num_values));
}

int FactorGraph::num_factors() const {
  int count = 0;
  for (const internal::FamilyRecord& record : families_) {
    // Free places have no factor.
    count += record.num_factors - static_cast<int>(record.free_places.size());
  }
  return count;
}

bool FactorGraph::HasFactor(FamilyId id, int factor) const {
  if (id < 0 || id >= num_families()) {
    return false;
  }
  // Marks of an edit are wiped when its check ends, so a place is either taken or free here.
  const internal::FamilyRecord& record = families_[Index(id)];
  const std::vector<internal::Place>& places = edits_->families[Index(id)].places;
  return factor >= 0 && factor < record.num_factors &&
         // Without an array of places nothing was removed.
         (places.empty() || places[Index(factor)] == internal::Place::kIncremental);
}

// The k-th from the end: ids that were freed last are given out first, and an edit that is not
// applied has taken none. Of the same ambient size only, for the room in the state stays where it
// is.
VariableId FactorGraph::FreeVariable(int ambient_size, bool borrowed, int k) const {
  const auto& free = edits_->free_variables;
  const auto found =
      ambient_size > 0 ? free.find(internal::FreeKey(ambient_size, borrowed)) : free.end();
  if (found == free.end() || Index(k) >= found->second.size()) {
    return -1;
  }
  return found->second[found->second.size() - 1 - Index(k)];
}

std::int32_t FactorGraph::FreePlace(FamilyId id, int k) const {
  const std::vector<std::int32_t>& places = families_[Index(id)].free_places;
  return Index(k) < places.size() ? places[places.size() - 1 - Index(k)] : -1;
}

// Zero until a factor of the place has been removed.
std::int32_t FactorGraph::Generation(FamilyId id, std::int32_t place) const {
  const std::vector<std::int32_t>& generations = edits_->families[Index(id)].generations;
  return Index(place) < generations.size() ? generations[Index(place)] : 0;
}

}  // namespace inceres
