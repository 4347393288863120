#include "inceres/graph/factor_graph.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <utility>

namespace inceres {

FactorGraph::VariableRecord FactorGraph::MakeOwned(int ambient_size, Role role, std::shared_ptr<const Manifold> manifold) {
  VariableRecord variable;
  variable.ambient_size = ambient_size;
  variable.tangent_size = manifold == nullptr ? ambient_size : manifold->TangentSize();
  variable.role = role;
  variable.manifold = std::move(manifold);
  return variable;
}

FactorGraph::VariableRecord FactorGraph::MakeBorrowed(const double* values, int ambient_size) {
  VariableRecord variable;
  variable.offset = -1;
  variable.borrowed = values;
  variable.ambient_size = ambient_size;
  variable.constant = true;
  return variable;
}

VariableId FactorGraph::AppendVariable(VariableRecord variable, const double* values) {
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
  if (tracked_) {
    first_touches_.emplace_back();
  }
  return num_variables() - 1;
}

VariableId FactorGraph::AddVariable(const double* values, int ambient_size, Role role, std::shared_ptr<const Manifold> manifold) {
  ++revision_;
  return AppendVariable(MakeOwned(ambient_size, role, std::move(manifold)), values);
}

VariableId FactorGraph::AddBorrowedConstant(const double* values, int ambient_size) {
  ++revision_;
  return AppendVariable(MakeBorrowed(values, ambient_size), nullptr);
}

FamilyId FactorGraph::AddFamily(std::shared_ptr<const FactorFamily> family) {
  assert(family != nullptr && "FactorGraph::AddFamily: null family");
  ++revision_;
  families_.emplace_back().family = std::move(family);
  return num_families() - 1;
}

int FactorGraph::Connect(FamilyId family, const VariableId* variables, std::shared_ptr<const Loss> loss) {
  assert(family >= 0 && family < num_families() && "FactorGraph::Connect: no such family");
  ++revision_;
  return AppendFactor(family, variables, std::move(loss));
}

void FactorGraph::ConnectMany(FamilyId family, std::vector<VariableId> variables,
                              std::vector<std::shared_ptr<const Loss>> losses) {
  assert(family >= 0 && family < num_families() && "FactorGraph::ConnectMany: no such family");
  if (variables.empty()) {
    return;
  }
  FamilyRecord& record = families_[Index(family)];
  const std::size_t num_slots = Index(record.family->num_slots());
  assert(num_slots > 0 && "FactorGraph::ConnectMany: factors without variables");
  const std::size_t count = variables.size() / num_slots;
  assert(count * num_slots == variables.size() && "FactorGraph::ConnectMany: an incomplete factor");
  assert((losses.empty() || losses.size() == count) && "FactorGraph::ConnectMany: a loss for each factor, or none at all");
  if (record.num_factors > 0 || tracked_) {
    for (std::size_t i = 0; i < count; ++i) {
      Connect(family, variables.data() + i * num_slots, losses.empty() ? nullptr : std::move(losses[i]));
    }
    return;
  }
  ++revision_;
  record.variables = std::move(variables);
  record.losses = std::move(losses);
  record.num_factors = static_cast<int>(count);
}

int FactorGraph::AppendFactor(FamilyId family, const VariableId* variables, std::shared_ptr<const Loss> loss) {
  FamilyRecord& record = families_[Index(family)];
  const int num_slots = record.family->num_slots();
  for (int s = 0; s < num_slots; ++s) {  // an insertion of the range takes longer
    record.variables.push_back(variables[s]);
  }
  if (loss != nullptr || !record.losses.empty()) {
    record.losses.resize(Index(record.num_factors));  // the first loss of the family: the factors before it have none
    record.losses.push_back(std::move(loss));
  }
  if (!record.places.empty()) {
    record.places.push_back(Place::kLive);
  }
  const int factor = record.num_factors++;
  if (tracked_) {
    record.links.resize(record.variables.size());
    LinkFactor(family, factor);
  }
  return factor;
}

void FactorGraph::SetLoss(FamilyId family, int factor, std::shared_ptr<const Loss> loss) {
  FamilyRecord& record = families_[Index(family)];
  if (loss != nullptr || !record.losses.empty()) {
    record.losses.resize(Index(record.num_factors));
    record.losses[Index(factor)] = std::move(loss);
  }
}

void FactorGraph::SetBounds(VariableId id, const double* lower, const double* upper) {
  constexpr double kMax = std::numeric_limits<double>::max();
  assert(id >= 0 && id < num_variables() && "FactorGraph::SetBounds: no such variable");
  const std::size_t size = Index(AmbientSize(id));
  VariableBounds bounds;
  bounds.lower = lower != nullptr ? std::vector<double>(lower, lower + size) : std::vector<double>(size, -kMax);
  bounds.upper = upper != nullptr ? std::vector<double>(upper, upper + size) : std::vector<double>(size, kMax);
  // A NaN stays, for Validate() to find.
  const bool none = std::all_of(bounds.lower.begin(), bounds.lower.end(), [](double b) { return b <= -kMax; }) &&
                    std::all_of(bounds.upper.begin(), bounds.upper.end(), [](double b) { return b >= kMax; });
  if (none) {
    bounds_.erase(id);
  } else {
    bounds_[id] = std::move(bounds);
  }
}

void FactorGraph::PinLinearisation(VariableId id, const double* values) {
  assert(id >= 0 && id < num_variables() && "FactorGraph::PinLinearisation: no such variable");
  if (values == nullptr) {
    pins_.erase(id);
  } else {
    pins_[id].assign(values, values + AmbientSize(id));
  }
}

void FactorGraph::SetValues(VariableId id, const double* values) {
  const VariableRecord& variable = variables_[Index(id)];
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
  for (const FamilyRecord& record : families_) {
    count += record.num_factors - static_cast<int>(record.free_places.size());
  }
  return count;
}

bool FactorGraph::HasFactor(FamilyId id, int factor) const {
  if (id < 0 || id >= num_families()) {
    return false;
  }
  const FamilyRecord& record = families_[Index(id)];
  return factor >= 0 && factor < record.num_factors && (record.places.empty() || record.places[Index(factor)] == Place::kLive);
}

VariableId FactorGraph::FreeVariable(int ambient_size, bool borrowed, int k) const {
  const auto found = ambient_size > 0 ? free_variables_.find(FreeKey(ambient_size, borrowed)) : free_variables_.end();
  if (found == free_variables_.end() || Index(k) >= found->second.size()) {
    return -1;
  }
  return found->second[found->second.size() - 1 - Index(k)];
}

std::int32_t FactorGraph::FreePlace(FamilyId id, int k) const {
  const std::vector<std::int32_t>& places = families_[Index(id)].free_places;
  return Index(k) < places.size() ? places[places.size() - 1 - Index(k)] : -1;
}

}  // namespace inceres
