#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "linearize/incremental_values.h"

namespace inceres::internal {

/// Tangent maps of the variables of a living graph, recomputed where a variable has moved, and the place of each variable's step
/// in one padded vector. Addresses never move.
class IncrementalTangents {
 public:
  /// Takes over a variable that takes part in the system (`inside`), or stays constant without a place in it.
  void Add(const FactorGraph& graph, VariableId id, bool inside);
  /// Gives the place in the padded vector back.
  void Remove(VariableId id);

  const TangentMap& map(VariableId id) const { return maps_[id]; }
  /// Quads into the padded step; -1 for a variable outside the system.
  std::int32_t quad(VariableId id) const { return quads_[id]; }
  int tangent_size(VariableId id) const { return maps_[id].tangent_size; }
  std::int32_t num_quads() const { return num_quads_; }

  void MarkMoved(VariableId id) { stale_[id] = 1; }
  /// Brings the map up to date with the current values, or those the variable is pinned to. False if the manifold's PlusJacobian
  /// fails.
  bool Refresh(const FactorGraph& graph, const IncrementalValues& values, VariableId id);

 private:
  std::deque<TangentMap> maps_;
  std::deque<std::vector<double>> plus_jacobians_;  // empty for Euclidean variables
  std::deque<std::vector<int>> selections_;
  std::vector<char> stale_;
  std::vector<std::int32_t> quads_;
  std::vector<std::vector<std::int32_t>> free_quads_;  // by the number of quads
  std::int32_t num_quads_ = 0;
};

}  // namespace inceres::internal
