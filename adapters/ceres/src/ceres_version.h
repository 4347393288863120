#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

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

/// Bounds of a block as Ceres sees them.
enum class BoundsKind {
  kNone,        ///< no value is bounded
  kBounded,     ///< some value is bounded
  kInfeasible,  ///< nothing can be done: a constant lies outside, or a lower bound is not below its upper bound
};

/// Appends the block's lower bounds, then its upper bounds, to *bounds if any value is bounded. Two map lookups a value: Ceres
/// has no cheaper question. Unbounded is ∓max; infinities set by the user are unbounded too, and so is NaN, as in Ceres.
inline BoundsKind ReadBounds(const ceres::Problem& problem, const double* values, int size, bool constant,
                             std::vector<double>* bounds) {
  constexpr double kMax = std::numeric_limits<double>::max();
  const auto count = static_cast<std::size_t>(size);
  const std::size_t first = bounds->size();
  bounds->resize(first + 2 * count);
  BoundsKind kind = BoundsKind::kNone;
  for (int i = 0; i < size; ++i) {
    const double lower = problem.GetParameterLowerBound(values, i);
    const double upper = problem.GetParameterUpperBound(values, i);
    if (constant ? values[i] < lower || values[i] > upper : lower >= upper) {
      kind = BoundsKind::kInfeasible;
    } else if (kind == BoundsKind::kNone && (lower > -kMax || upper < kMax)) {
      kind = BoundsKind::kBounded;
    }
    double* pair = bounds->data() + first + i;
    pair[0] = std::isnan(lower) ? -kMax : lower;
    pair[count] = std::isnan(upper) ? kMax : upper;
  }
  if (kind == BoundsKind::kNone) {
    bounds->resize(first);
  }
  return kind;
}

}  // namespace inceres::internal
