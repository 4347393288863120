#include "inceres/graph/factor_graph.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <utility>

namespace inceres {

VariableId FactorGraph::AddVariable(const double* values, int ambient_size, Role role, std::shared_ptr<const Manifold> manifold) {
  VariableRecord& variable = variables_.emplace_back();
  variable.offset = static_cast<std::int64_t>(state_.size());
  variable.ambient_size = ambient_size;
  variable.tangent_size = manifold == nullptr ? ambient_size : manifold->TangentSize();
  variable.role = role;
  variable.manifold = std::move(manifold);
  const std::size_t num_values = static_cast<std::size_t>(std::max(ambient_size, 0));
  if (values != nullptr) {
    state_.insert(state_.end(), values, values + num_values);
  } else {
    // Nothing is checked here: Validate() finds the NaN and names the variable.
    state_.insert(state_.end(), num_values, std::numeric_limits<double>::quiet_NaN());
  }
  return num_variables() - 1;
}

VariableId FactorGraph::AddBorrowedConstant(const double* values, int ambient_size) {
  VariableRecord& variable = variables_.emplace_back();
  variable.offset = -1;
  variable.borrowed = values;
  variable.ambient_size = ambient_size;
  variable.constant = true;
  return num_variables() - 1;
}

FamilyId FactorGraph::AddFamily(std::shared_ptr<const FactorFamily> family) {
  assert(family != nullptr && "FactorGraph::AddFamily: null family");
  families_.emplace_back().family = std::move(family);
  return num_families() - 1;
}

int FactorGraph::Connect(FamilyId family, const VariableId* variables, std::shared_ptr<const Loss> loss) {
  assert(family >= 0 && family < num_families() && "FactorGraph::Connect: no such family");
  FamilyRecord& record = families_[Index(family)];
  record.variables.insert(record.variables.end(), variables, variables + record.family->num_slots());
  if (loss != nullptr || !record.losses.empty()) {
    record.losses.resize(Index(record.num_factors));  // the first loss of the family: the factors before it have none
    record.losses.push_back(std::move(loss));
  }
  return record.num_factors++;
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
    count += record.num_factors;
  }
  return count;
}

}  // namespace inceres
