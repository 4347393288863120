#pragma once

#include <cstdint>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/status.h"
#include "linearize/variable_store.h"

namespace inceres::internal {

/// The bounds of a living problem's variables, and who is held at one: a projected Gauss–Newton
/// method. A coordinate whose value lies on a bound while −g points out of it is held: H has no row
/// of it and it takes no step, until its gradient turns. All others step as if they were free, and
/// what would leave is cut off at the bound, coordinate by coordinate.
///
/// Of variables in Rⁿ, some coordinates of which may be constant (SubsetManifold): there a tangent
/// coordinate is one of the values. Bounds of a constant do not count.
///
/// Cost: without bounds in the graph none. Source: Bertsekas, "Projected Newton methods for
/// optimization problems with simple constraints", SIAM J. Control and Optimization 20(2), 1982.
class ActiveBounds {
 public:
  ActiveBounds(const FactorGraph& graph, VariableStore* variables)
      : graph_(graph), variables_(*variables) {}

  /// Refuses bounds of a variable on any other manifold.
  static Status Check(const GraphEdit& edit);

  /// Whether any variable has bounds.
  bool any() const { return graph_.HasBounds(); }
  int num_held() const { return num_held_; }
  /// Per tangent coordinate of the variable with this place in the padded vectors, whether it is
  /// held; null if none is of any variable.
  const char* held(std::int32_t quad) const;

  /// Moves current values that are outside to the nearest bound. True if it did.
  bool Confine(VariableId id);

  /// Decides anew who is held, by −g; true if that changes anything. IsDue only tells.
  bool Hold(VariableId id, std::int32_t quad, const double* downhill) {
    return any() && HoldAtBounds(id, quad, downhill);
  }
  bool IsDue(VariableId id, std::int32_t quad, const double* downhill) const;
  /// Nobody is, of a variable of this tangent size.
  bool Release(std::int32_t quad, int size);

  /// Shortens the step from the current values. True if it would have left them.
  bool CutOff(VariableId id, std::int32_t quad, double* step) const {
    return any() && CutOffAtBounds(id, quad, step);
  }
  /// After such a step: what was cut off at a bound lies on it to the last bit.
  void Land(VariableId id, const double* step) {
    if (any()) {
      LandAtBounds(id, step);
    }
  }

 private:
  bool HoldAtBounds(VariableId id, std::int32_t quad, const double* downhill);
  bool CutOffAtBounds(VariableId id, std::int32_t quad, double* step) const;
  void LandAtBounds(VariableId id, const double* step);
  template <typename Visit>
  void ForEachCoordinate(VariableId id, const Visit& visit) const;
  static bool PointsOut(double x, double lower, double upper, double downhill) {
    return (x <= lower && downhill < 0.0) || (x >= upper && downhill > 0.0);
  }

  const FactorGraph& graph_;
  VariableStore& variables_;
  std::vector<char> held_;  // laid out as the padded vectors
  int num_held_ = 0;
};

}  // namespace inceres::internal
