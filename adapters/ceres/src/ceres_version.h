#pragma once

#include <limits>

#include <ceres/problem.h>
#include <ceres/version.h>

// Everything that differs between Ceres versions is in this file. Ceres 2.1 calls manifolds' sizes "tangent", shows bounds, and
// turns a LocalParameterization into a Manifold of its own, so no other file names a LocalParameterization.
#if CERES_VERSION_MAJOR != 2 || CERES_VERSION_MINOR != 1
#error "The Ceres adapter of inceres is written for Ceres 2.1; see adapters/ceres/src/ceres_version.h"
#endif

namespace inceres::internal {

/// The manifold of a block, whichever of the two ways the user set it; null if Euclidean. Only Plus, PlusJacobian and the sizes
/// may be called: Minus of an adapted LocalParameterization aborts in Ceres 2.1.
inline const ceres::Manifold* ManifoldOf(const ceres::Problem& problem, const double* values) {
  return problem.GetManifold(values);
}

/// What the bounds of a block mean for a solver that knows no bounds.
enum class BoundsKind {
  kNone,        ///< no component is bounded
  kFeasible,    ///< some component is bounded and every value lies within
  kInfeasible,  ///< some value lies outside
};

/// Two map lookups a component: Ceres has no cheaper question. Unbounded is ∓max; infinities set by the user are unbounded too.
inline BoundsKind BoundsOf(const ceres::Problem& problem, const double* values, int size) {
  constexpr double kMax = std::numeric_limits<double>::max();
  BoundsKind kind = BoundsKind::kNone;
  for (int i = 0; i < size; ++i) {
    const double lower = problem.GetParameterLowerBound(values, i);
    const double upper = problem.GetParameterUpperBound(values, i);
    if (lower > -kMax || upper < kMax) {
      if (values[i] < lower || values[i] > upper) {
        return BoundsKind::kInfeasible;
      }
      kind = BoundsKind::kFeasible;
    }
  }
  return kind;
}

}  // namespace inceres::internal
