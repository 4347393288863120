#include "linearisation/live_tangents.h"

#include <algorithm>
#include <cmath>

#include "block/kernels.h"
#include "linearisation/tangent_classes.h"

namespace inceres::internal {

void LiveTangents::Grow(const FactorGraph& graph) {
  for (auto id = static_cast<VariableId>(maps_.size()); id < graph.num_variables(); ++id) {
    TangentMap map;
    map.ambient_size = graph.AmbientSize(id);
    map.tangent_size = graph.TangentSize(id);
    map.kind = graph.IsConstant(id) ? TangentMap::Kind::kConstant : TangentMap::Kind::kIdentity;
    maps_.push_back(map);
    const bool curved = map.kind != TangentMap::Kind::kConstant && graph.manifold(id) != nullptr;
    plus_jacobians_.emplace_back(curved ? map.ambient_size * map.tangent_size : 0);
    selections_.emplace_back(curved ? map.tangent_size : 0);
    stale_.push_back(curved ? 1 : 0);
    if (map.kind == TangentMap::Kind::kConstant) {
      quads_.push_back(-1);
    } else {
      quads_.push_back(num_quads_);
      num_quads_ += PadToQuad(map.tangent_size) / kQuad;
    }
  }
}

bool LiveTangents::Refresh(const FactorGraph& graph, const LiveValues& values, VariableId id) {
  std::vector<double>& jacobian = plus_jacobians_[id];
  if (stale_[id] == 0 || jacobian.empty()) {
    return true;
  }
  if (!graph.manifold(id)->PlusJacobian(values.current(id), jacobian.data()) ||
      !std::all_of(jacobian.begin(), jacobian.end(), [](double entry) { return std::isfinite(entry); })) {
    return false;
  }
  maps_[id].plus_jacobian = jacobian.data();
  ClassifyTangentMap(&maps_[id], selections_[id].data());
  stale_[id] = 0;
  return true;
}

}  // namespace inceres::internal
