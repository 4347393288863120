#pragma once

#include <cstddef>
#include <memory>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// x ⊞ δ of a variable, into `moved`. False if its manifold's Plus fails.
bool MoveVariable(const FactorGraph& graph, VariableId id, const double* x, const double* delta,
                  double* moved);

/// The values of a variable into its bounds. A NaN stays one.
void ClampToBounds(const VariableBounds& bounds, double* x);

/// The tangent map of a variable at its point: x, or where the graph pins it. Its address is that
/// of the Tangent.
class Tangent {
 public:
  /// Takes over a variable. Nobody wants Jacobians of one that is not `wanted`: it counts as
  /// constant.
  void Set(const FactorGraph& graph, VariableId id, bool wanted);

  const TangentMap& map() const { return map_; }
  /// Whether the map depends on the point.
  bool is_curved() const { return curved_ != nullptr && curved_->size > 0; }

  /// M := ∂(x ⊞ δ)/∂δ at x, checked. Returns null, or what is wrong with it: words to follow
  /// "PlusJacobian".
  const char* Compute(const FactorGraph& graph, VariableId id, const double* x);
  /// The same, if the variable has moved since.
  const char* Refresh(const FactorGraph& graph, VariableId id, const double* x) {
    return is_curved() && curved_->stale ? Compute(graph, id, x) : nullptr;
  }
  void MarkMoved() {
    if (curved_ != nullptr) {
      curved_->stale = true;
    }
  }
  // Of curved ones only.

  /// The same at a candidate, for whoever asks before it is accepted: then the map is that.
  const char* ComputeCandidate(const FactorGraph& graph, VariableId id, const double* x);
  /// The candidate is another point now: what was computed at the one before is no longer its map.
  void DropCandidate() { curved_->has_candidate = false; }
  /// The candidate is the point now. Its map is stale unless it was computed there.
  void AcceptCandidate();

 private:
  // What it points to follows it in memory, for windows have many and make them anew.
  struct alignas(16) Curved {
    double* M;
    double* candidate_M;
    int* selection;
    int size;      // of M; 0 while the variable has no manifold
    int capacity;  // of M
    bool stale;
    bool has_candidate;  // candidate_M is the candidate's
  };
  struct Free {
    void operator()(Curved* curved) const { ::operator delete(curved); }
  };

  static std::unique_ptr<Curved, Free> MakeCurved(int size);

  TangentMap map_;
  std::unique_ptr<Curved, Free> curved_;  // null of a variable that never had a manifold
};

}  // namespace inceres::internal
