#pragma once

#include <cstdint>
#include <map>
#include <tuple>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "linearize/layout.h"
#include "linearize/tangent.h"

namespace inceres::internal {

/// The two points of a trust-region iteration, current and candidate: all values as the graph lays
/// them out, and the tangent maps of the variables. Neither moves in memory; AcceptCandidate swaps
/// them.
class PointPair {
 public:
  PointPair(const FactorGraph& graph, const Layout& layout);

  /// From now on for this graph, at its values; its structure (trust_region/structure.h) is that of
  /// the one before.
  void Rebind(const FactorGraph& graph);

  const std::vector<double>& current() const { return current_; }
  const std::vector<double>& candidate() const { return candidate_; }
  /// The candidate itself, for who moves variables without a manifold one by one.
  std::vector<double>& mutable_candidate() { return candidate_; }
  /// Its address stays. Variables without a manifold have one in common if they are as large.
  const TangentMap& tangent_map(VariableId id) const { return *maps_[id]; }
  /// The same per VariableId.
  const TangentMap* const* tangent_maps() const { return maps_.data(); }

  /// Whether any variable that moves has bounds.
  bool IsConstrained() const { return !bounds_.empty(); }

  /// current := these values, a state as the graph lays it out.
  void SetCurrent(const std::vector<double>& state);

  /// candidate := current ⊞ delta (packed), clamped to the bounds. False if a manifold's Plus
  /// fails; others are then already overwritten.
  bool MoveCandidate(const double* delta);

  /// current := candidate, with the tangent maps that were computed there.
  void AcceptCandidate();

  /// The state at the address that factors point to, which stays: the current one or the candidate.
  const std::vector<double>& pointed() const {
    return points_to_candidate_ ? candidate_ : current_;
  }
  /// Which of the two that is from now on: their values change places where it is the other one.
  void PointTo(bool candidate);

  /// The tangent maps at the current point; and at the candidate, where they count once it is
  /// accepted. An error names the variable.
  Status ComputeTangents();
  Status ComputeCandidateTangents();

  std::int64_t Bytes() const;

 private:
  // Values without a manifold, neighbors both in the state and in the packed tangent vector.
  struct FlatRun {
    std::int64_t offset;  // in the state
    int packed;
    int size;
  };

  void BuildTangents();
  void AddFlat(VariableId id);
  void BuildBounds();
  template <typename Compute>
  Status ComputeTangentsAt(const std::vector<double>& state, const Compute& compute);

  const FactorGraph* graph_;
  const Layout& layout_;
  std::vector<double> current_;
  std::vector<double> candidate_;
  bool points_to_candidate_ = false;
  std::vector<const TangentMap*> maps_;  // per VariableId
  // of those without a manifold, or that do not move: by sizes, and whether they do
  std::map<std::tuple<int, int, bool>, Tangent> flat_;
  std::vector<FlatRun> flat_runs_;  // of all that move, in the order of layout_.variables
  std::vector<VariableId> curved_;  // the others, in the same order
  std::vector<Tangent> tangents_;   // of those
  // per entry of layout_.variables, null if free; empty if all are
  std::vector<const VariableBounds*> bounds_;
};

}  // namespace inceres::internal
