#include "linearize/incremental_tangents.h"

#include <algorithm>

#include "linearize/tangent_classes.h"
#include "simd/kernels.h"

namespace inceres::internal {
namespace {

std::size_t NumQuads(int tangent_size) {
  return static_cast<std::size_t>(PadToQuad(tangent_size) / kQuad);
}

}  // namespace

void IncrementalTangents::Add(const FactorGraph& graph, VariableId id, bool inside) {
  if (id >= static_cast<VariableId>(maps_.size())) {
    maps_.resize(id + 1);
    plus_jacobians_.resize(id + 1);
    selections_.resize(id + 1);
    stale_.resize(id + 1, 0);
    quads_.resize(id + 1, -1);
  }
  TangentMap& map = maps_[id];
  map = TangentMap();
  map.ambient_size = graph.AmbientSize(id);
  map.tangent_size = graph.TangentSize(id);
  map.kind = inside ? TangentMap::Kind::kIdentity : TangentMap::Kind::kConstant;
  const bool curved = inside && graph.manifold(id) != nullptr;
  plus_jacobians_[id].resize(curved ? map.ambient_size * map.tangent_size : 0);
  selections_[id].resize(curved ? map.tangent_size : 0);
  stale_[id] = curved ? 1 : 0;
  if (!inside) {
    return;
  }
  const std::size_t quads = NumQuads(map.tangent_size);
  if (quads < free_quads_.size() && !free_quads_[quads].empty()) {
    quads_[id] = free_quads_[quads].back();
    free_quads_[quads].pop_back();
  } else {
    quads_[id] = num_quads_;
    num_quads_ += static_cast<std::int32_t>(quads);
  }
}

void IncrementalTangents::Remove(VariableId id) {
  if (quads_[id] < 0) {
    return;
  }
  const std::size_t quads = NumQuads(maps_[id].tangent_size);
  free_quads_.resize(std::max(free_quads_.size(), quads + 1));
  free_quads_[quads].push_back(quads_[id]);
  quads_[id] = -1;
}

bool IncrementalTangents::Refresh(const FactorGraph& graph, const IncrementalValues& values, VariableId id) {
  std::vector<double>& jacobian = plus_jacobians_[id];
  if (stale_[id] == 0 || jacobian.empty()) {
    return true;
  }
  const double* pinned = graph.HasPins() ? graph.PinnedValues(id) : nullptr;
  if (EvaluatePlusJacobian(*graph.manifold(id), pinned != nullptr ? pinned : values.current(id),
                           static_cast<int>(jacobian.size()), jacobian.data()) != nullptr) {
    return false;
  }
  maps_[id].plus_jacobian = jacobian.data();
  ClassifyTangentMap(&maps_[id], selections_[id].data());
  stale_[id] = 0;
  return true;
}

}  // namespace inceres::internal
