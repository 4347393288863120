#include "linearize/factor_linearizer.h"

#include <algorithm>
#include <string>
#include <utility>

#include "linearize/moved_factors.h"
#include "linearize/robustify.h"
#include "linearize/tangent_classes.h"

namespace inceres::internal {

FactorLinearizer::FactorLinearizer(const FactorGraph& graph, ValuesOf values, std::function<bool(VariableId)> wanted)
    : graph_(graph), values_(std::move(values)), wanted_(std::move(wanted)) {
  constant_.kind = TangentMap::Kind::kConstant;
}

Status FactorLinearizer::MapOf(VariableId id, const TangentMap** map) {
  const auto [found, added] = tangents_.try_emplace(id);
  Tangent& tangent = found->second;
  *map = &tangent.map;
  if (!added) {
    return Status::Ok();
  }
  tangent.map.ambient_size = graph_.AmbientSize(id);
  tangent.map.tangent_size = graph_.TangentSize(id);
  const Manifold* manifold = graph_.manifold(id);
  if (manifold == nullptr) {
    return Status::Ok();
  }
  const double* pinned = graph_.PinnedValues(id);
  const int count = tangent.map.ambient_size * tangent.map.tangent_size;
  tangent.plus_jacobian.resize(count);
  tangent.selection.resize(tangent.map.tangent_size);
  if (EvaluatePlusJacobian(*manifold, pinned != nullptr ? pinned : values_(id), count, tangent.plus_jacobian.data()) != nullptr) {
    tangents_.erase(found);
    return Status::Error(StatusCode::kEvaluationFailed,
                         "the manifold of variable " + std::to_string(id) + " has no Jacobian here");
  }
  tangent.map.plus_jacobian = tangent.plus_jacobian.data();
  ClassifyTangentMap(&tangent.map, tangent.selection.data());
  return Status::Ok();
}

Status FactorLinearizer::FillTables(FactorId id) {
  const FactorFamily& family = graph_.family(id.family);
  const auto num_slots = static_cast<std::size_t>(family.num_slots());
  const std::size_t places = static_cast<std::size_t>(id.index) + 1;
  if (parameters_.size() < places * num_slots) {
    parameters_.resize(places * num_slots);
    jacobian_parameters_.resize(places * num_slots);
    maps_.resize(places * num_slots);
  }
  residuals_.resize(std::max(residuals_.size(), places * static_cast<std::size_t>(family.residual_size())));
  slots_.resize(num_slots);
  views_.resize(num_slots);
  offsets_.resize(num_slots);
  pinned_ = false;
  std::ptrdiff_t size = 0;
  for (std::size_t s = 0; s < num_slots; ++s) {
    const VariableId variable = graph_.Variables(id.family, id.index)[s];
    const std::size_t at = static_cast<std::size_t>(id.index) * num_slots + s;
    const bool wanted = wanted_(variable);
    const double* pin = wanted ? graph_.PinnedValues(variable) : nullptr;
    parameters_[at] = values_(variable);
    jacobian_parameters_[at] = pin != nullptr ? pin : parameters_[at];
    pinned_ = pinned_ || pin != nullptr;
    maps_[at] = &constant_;
    const Status mapped = wanted ? MapOf(variable, &maps_[at]) : Status::Ok();
    if (!mapped.ok()) {
      return mapped;
    }
    offsets_[s] = wanted ? 0 : -1;
    const int columns = family.slot(static_cast<int>(s)).tangent_size;
    slots_[s] = {nullptr, std::ptrdiff_t{family.residual_size()} * PadToQuad(columns), PadToQuad(columns), columns};
    size += wanted ? slots_[s].factor_stride : 0;
  }
  jacobians_.assign(static_cast<std::size_t>(size), 0.0);
  double* next = jacobians_.data();
  for (std::size_t s = 0; s < num_slots; ++s) {
    slots_[s].data = offsets_[s] < 0 ? nullptr : next;
    next += offsets_[s] < 0 ? 0 : slots_[s].factor_stride;
    views_[s] = {slots_[s].data, 0, slots_[s].row_stride};  // whatever the factor's place, this is its block
  }
  return Status::Ok();
}

Status FactorLinearizer::Evaluate(FactorId id) {
  FactorBatch batch;
  batch.begin = id.index;
  batch.end = id.index + 1;
  batch.parameters = jacobian_parameters_.data();
  batch.tangent_maps = maps_.data();
  batch.residuals = residuals_.data();
  batch.jacobians = views_.data();
  const FactorFamily& family = graph_.family(id.family);
  EvaluationFailure failure = family.Evaluate(batch);
  if (!failure.failed()) {
    failure = EvaluateMoved(family, batch, parameters_.data(), [this](int) { return pinned_; });
  }
  const double* const* values = parameters_.data() + static_cast<std::ptrdiff_t>(id.index) * family.num_slots();
  return failure.failed() ? Status::Error(StatusCode::kEvaluationFailed, graph_.DescribeFailure(id.family, failure, values))
                          : Status::Ok();
}

Status FactorLinearizer::Linearize(FactorId id, LinearizedFactor* result) {
  Status status = FillTables(id);
  status = status.ok() ? Evaluate(id) : status;
  if (!status.ok()) {
    return status;
  }
  const FactorFamily& family = graph_.family(id.family);
  const int rows = family.residual_size();
  double* f = residuals_.data() + static_cast<std::ptrdiff_t>(id.index) * rows;
  if (const Loss* loss = graph_.loss(id.family, id.index)) {
    RobustifyFactor(*loss, rows, family.num_slots(), slots_.data(), 0, offsets_.data(), /*reduces_curvature=*/false, f);
  }
  *result = {rows, f, slots_.data()};
  return Status::Ok();
}

}  // namespace inceres::internal
