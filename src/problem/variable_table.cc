#include <algorithm>
#include <cassert>
#include <limits>
#include <utility>

#include "problem/edited_graph.h"

// The variables of a graph. Values of all that are not borrowed lie in one array, the state, at an
// offset each: solvers copy and move all of them at once. Few are bounded or pinned, so these are
// maps, and a graph without any pays nothing.

namespace inceres::internal {

VariableRecord VariableRecord::Owned(int ambient_size, Role role,
                                     std::shared_ptr<const Manifold> manifold) {
  VariableRecord variable;
  variable.ambient_size = ambient_size;
  variable.tangent_size = manifold == nullptr ? ambient_size : manifold->TangentSize();
  variable.role = role;
  variable.manifold = std::move(manifold);
  return variable;
}

// Tangent size 0, so that nothing can move borrowed values, whatever SetConstant says.
VariableRecord VariableRecord::Borrowed(const double* values, int ambient_size) {
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

VariableId VariableTable::Append(VariableRecord variable, const double* values) {
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
  variable.serial = num_added_++;
  records_.push_back(std::move(variable));
  return size() - 1;
}

void VariableTable::SetValues(VariableId id, const double* values) {
  const VariableRecord& variable = (*this)[id];
  // Borrowed values are their owner's: nothing is written there.
  if (variable.offset >= 0) {
    std::copy_n(values, variable.ambient_size, state_.begin() + variable.offset);
  }
}

void VariableTable::SetGroup(VariableId id, int group) {
  std::int32_t& now = records_[IndexOf(id)].group;
  num_grouped_ += (group != 0 ? 1 : 0) - (now != 0 ? 1 : 0);
  now = group;
}

// A variable with nothing but bounds that are none is not bounded.
void VariableTable::SetBounds(VariableId id, const double* lower, const double* upper) {
  assert(id >= 0 && id < size() && "SetBounds: no such variable");
  VariableBounds bounds;
  if (MakeBounds(lower, upper, (*this)[id].ambient_size, &bounds)) {
    bounds_[id] = std::move(bounds);
  } else {
    bounds_.erase(id);
  }
}

void VariableTable::Pin(VariableId id, const double* values) {
  assert(id >= 0 && id < size() && "PinLinearization: no such variable");
  if (values == nullptr) {
    pins_.erase(id);
  } else {
    pins_[id].assign(values, values + (*this)[id].ambient_size);
  }
}

// The room keeps zeros, so that a look for values that are not finite may run over all of the
// state.
void VariableTable::Remove(VariableId id) {
  VariableRecord& variable = records_[IndexOf(id)];
  if (variable.offset >= 0) {
    std::fill_n(state_.begin() + variable.offset, variable.ambient_size, 0.0);
  }
  variable.borrowed = nullptr;
  variable.manifold = nullptr;
  // A constant frame of no dimension: what meets it by mistake moves nothing. The size stays, by
  // which its id is found again, and so does the offset of its room.
  variable.tangent_size = 0;
  variable.role = Role::kFrame;
  variable.constant = true;
  variable.removed = true;
  SetGroup(id, 0);
  bounds_.erase(id);
  pins_.erase(id);
  ++num_removed_;
}

// The k-th from the end: ids that were freed last are given out first, and an edit that is not
// applied has taken none. Of the same ambient size only, for the room in the state stays where it
// is.
VariableId VariableTable::FreeId(int ambient_size, bool borrowed, int k) const {
  const auto found = ambient_size > 0 ? free_.find(Key(ambient_size, borrowed)) : free_.end();
  if (found == free_.end() || IndexOf(k) >= found->second.size()) {
    return -1;
  }
  return found->second[found->second.size() - 1 - IndexOf(k)];
}

// Whoever took ids has taken them from the back, one after the other.
void VariableTable::Reuse(VariableId id, VariableRecord variable, const double* values) {
  std::vector<VariableId>& ids = free_.at(KeyOf(variable));
  assert((*this)[id].removed && ids.back() == id);
  ids.pop_back();
  --num_removed_;
  variable.offset = (*this)[id].offset;
  variable.serial = num_added_++;
  records_[IndexOf(id)] = std::move(variable);
  // Values last: SetValues writes to where the record says.
  SetValues(id, values);
}

void VariableTable::Reserve(int num_variables, int num_values) {
  records_.reserve(IndexOf(num_variables));
  state_.reserve(IndexOf(num_values));
}

void VariableTable::ReserveFor(std::size_t num_new, std::size_t num_values,
                               const std::vector<VariableId>& free) {
  ReserveRoom(&records_, records_.size() + num_new);
  ReserveRoom(&state_, state_.size() + num_values);
  for (const VariableId id : free) {
    // Makes the list if it is the first of this size: Free looks it up without making any.
    std::vector<VariableId>& ids = free_[KeyOf((*this)[id])];
    ReserveRoom(&ids, ids.size() + free.size());
  }
}

}  // namespace inceres::internal
