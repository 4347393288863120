#include "linearize/factor_linearizer.h"

#include <algorithm>
#include <string>
#include <utility>

#include "linearize/robustify.h"

namespace inceres::internal {

// Single factors in the form in which the evaluator has all of them: M at the pin or at the value,
// J M, then √ρ' (I − α n nᵀ) J and the residual that goes with it. Tangent maps are computed once
// a variable and kept, since marginalization asks for many factors of the same few variables; the
// values must stay while this object lives. Tables of a family have room for all places up to the
// factor's, but Jacobians for one factor only.

FactorLinearizer::FactorLinearizer(const FactorGraph& graph, ValuesOf values,
                                   std::function<bool(VariableId)> wanted)
    : graph_(graph), values_(std::move(values)), wanted_(std::move(wanted)) {
  constant_.kind = TangentMap::Kind::kConstant;
}

// The address of a map's element stays, so tables may point to it.
Status FactorLinearizer::MapOf(VariableId id, const TangentMap** map) {
  const auto [found, added] = tangents_.try_emplace(id);
  Tangent& tangent = found->second;
  *map = &tangent.map();
  // Computed for another factor of the variable.
  if (!added) {
    return Status::Ok();
  }
  tangent.Set(graph_, id, /*wanted=*/true);
  if (tangent.Refresh(graph_, id, values_(id)) != nullptr) {
    // Not kept: the next factor that asks would take it for computed.
    tangents_.erase(found);
    return Status::Error(
        StatusCode::kEvaluationFailed,
        "the manifold of variable " + std::to_string(id) + " has no Jacobian here");
  }
  return Status::Ok();
}

// Whatever the factor's place, its Jacobians are at the beginning. Jacobians of slots follow each
// other, each padded as the evaluator's are; those that nobody wants have no room, a null pointer
// and a map that says constant, so that the family does not write them. Cost: the slots, and tables
// that grow to the factor's place once.
Status FactorLinearizer::Connect(FactorId id, Linearization* factors) {
  factors->GrowTables(std::max(factors->num_factors, id.index + 1));
  slots_ = factors->slots;
  offsets_.resize(slots_.size());
  std::ptrdiff_t size = 0;
  for (int s = 0; s < factors->num_slots; ++s) {
    const VariableId variable = graph_.Variables(id.family, id.index)[s];
    const bool wanted = wanted_(variable);
    const TangentMap* map = &constant_;
    const Status mapped = wanted ? MapOf(variable, &map) : Status::Ok();
    if (!mapped.ok()) {
      return mapped;
    }
    // Where no Jacobian is wanted a pin has nothing to freeze.
    factors->Connect(static_cast<std::size_t>(factors->Entry(id.index)) + s, values_(variable),
                     wanted ? graph_.PinnedValues(variable) : nullptr, *map);
    offsets_[s] = wanted ? 0 : -1;
    size += wanted ? slots_[s].factor_stride : 0;
  }
  // Zeroed, padding included: kernels read whole quads.
  jacobians_.assign(static_cast<std::size_t>(size), 0.0);
  double* next = jacobians_.data();
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    slots_[s].data = offsets_[s] < 0 ? nullptr : next;
    next += offsets_[s] < 0 ? 0 : slots_[s].factor_stride;
    // A stride of 0 from factor to factor, so that every place of the family is this one.
    factors->views[s] = {slots_[s].data, 0, slots_[s].row_stride};
  }
  return Status::Ok();
}

// Residuals lie by place and Jacobians at the beginning, where the next factor overwrites them.
Status FactorLinearizer::LinearizePlainly(FactorId id, LinearizedFactor* result) {
  Linearization& factors = families_.try_emplace(id.family, graph_, id.family).first->second;
  const Status connected = Connect(id, &factors);
  if (!connected.ok()) {
    return connected;
  }
  const EvaluationFailure failure = factors.Linearize(id.index, id.index + 1);
  if (failure.failed()) {
    return Status::Error(
        StatusCode::kEvaluationFailed,
        graph_.DescribeFailure(id.family, failure, factors.LinearizedParameters(id.index)));
  }
  *result = {factors.residual_size,
             factors.residuals.data() + std::ptrdiff_t{id.index} * factors.residual_size,
             slots_.data()};
  return Status::Ok();
}

// Offsets of −1 tell the correction which slots have no Jacobian; the others are 0, as all that is
// asked of them is not to be negative.
Status FactorLinearizer::Linearize(FactorId id, LinearizedFactor* result) {
  const Status linearized = LinearizePlainly(id, result);
  if (!linearized.ok()) {
    return linearized;
  }
  Linearization& factors = families_.at(id.family);
  double* f = factors.residuals.data() + std::ptrdiff_t{id.index} * factors.residual_size;
  // The same correction as batch mode with Ceres's options.
  const LossValue value(graph_.loss(id.family, id.index), f, factors.residual_size);
  if (!value.HasRoot() || !value.HasWeight()) {
    const char* const reason = value.HasRoot() ? kLossWithoutWeight : kLossWithoutRoot;
    return Status::Error(
        StatusCode::kEvaluationFailed,
        graph_.DescribeFailure(id.family, {id.index, reason}, factors.Parameters(id.index)));
  }
  RobustifyFactor(value, factors.residual_size, factors.num_slots, slots_.data(), 0,
                  offsets_.data(), LossCurvature::kPositive, f);
  return Status::Ok();
}

}  // namespace inceres::internal
