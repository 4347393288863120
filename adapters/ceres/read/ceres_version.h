#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <ceres/version.h>

#include "src/trust_region/loop_options.h"

// Everything that differs between releases of Ceres is in this file and in
// dropin/src/ceres_symbols.h. 2.0 has LocalParameterizations only and 2.2 Manifolds only; 2.1 has
// both and shows a LocalParameterization as a Manifold of its own.
#define INCERES_CERES_RELEASE (100 * CERES_VERSION_MAJOR + CERES_VERSION_MINOR)
#if INCERES_CERES_RELEASE < 200 || INCERES_CERES_RELEASE > 202
#error "The Ceres adapter of inceres is written for Ceres 2.0, 2.1 and 2.2: read/ceres_version.h"
#endif
#define INCERES_CERES_HAS_MANIFOLDS (INCERES_CERES_RELEASE >= 201)
#define INCERES_CERES_HAS_LOCAL_PARAMETERIZATIONS (INCERES_CERES_RELEASE <= 201)

#if INCERES_CERES_HAS_MANIFOLDS
#include <ceres/manifold.h>
#else
#include <ceres/local_parameterization.h>
#endif

namespace inceres::internal {

#if INCERES_CERES_HAS_MANIFOLDS

/// What the user makes of a block's tangent space. Only the functions below may be asked of it:
/// Minus of a LocalParameterization aborts in Ceres 2.1.
using UserManifold = ceres::Manifold;

/// Of a block, whichever way the user set it; null if Euclidean.
inline const UserManifold* ManifoldOf(const ceres::Problem& problem, const double* values) {
  return problem.GetManifold(values);
}
inline int AmbientSizeOf(const UserManifold& manifold) {
  return manifold.AmbientSize();
}
inline int TangentSizeOf(const UserManifold& manifold) {
  return manifold.TangentSize();
}
inline bool PlusJacobianOf(const UserManifold& manifold, const double* x, double* jacobian) {
  return manifold.PlusJacobian(x, jacobian);
}

#else

using UserManifold = ceres::LocalParameterization;

inline const UserManifold* ManifoldOf(const ceres::Problem& problem, const double* values) {
  return problem.GetParameterization(values);
}
inline int AmbientSizeOf(const UserManifold& manifold) {
  return manifold.GlobalSize();
}
inline int TangentSizeOf(const UserManifold& manifold) {
  return manifold.LocalSize();
}
inline bool PlusJacobianOf(const UserManifold& manifold, const double* x, double* jacobian) {
  return manifold.ComputeJacobian(x, jacobian);
}

#endif

/// The evaluation callback that the problem was made with. Ceres shows it from 2.2 on; before, it
/// is what the caller tells.
inline ceres::EvaluationCallback* EvaluationCallbackOf(
    [[maybe_unused]] const ceres::Problem& problem,
    [[maybe_unused]] ceres::EvaluationCallback* told) {
#if INCERES_CERES_RELEASE >= 202
  return problem.options().evaluation_callback;
#else
  return told;
#endif
}

/// Whose trace exact mode follows.
constexpr CeresRules kCeresRules = INCERES_CERES_RELEASE >= 202 ? CeresRules::k22 : CeresRules::k21;

/// check(name, member, name, member, …) with the options that only some releases have. Only Ceres's
/// own linear algebra reads them.
template <typename Check>
void WithOptionsOfThisRelease(const Check& check) {
  using Options = ceres::Solver::Options;
#if INCERES_CERES_RELEASE >= 202
  check("linear_solver_ordering_type", &Options::linear_solver_ordering_type,
        "max_num_spse_iterations", &Options::max_num_spse_iterations, "use_spse_initialization",
        &Options::use_spse_initialization, "spse_tolerance", &Options::spse_tolerance);
#else
  check("use_postordering", &Options::use_postordering);
#endif
}

/// Copies to the summary what Ceres copies of the options that only some releases have.
inline void WriteOptionsOfThisRelease([[maybe_unused]] const ceres::Solver::Options& options,
                                      [[maybe_unused]] ceres::Solver::Summary* summary) {
#if INCERES_CERES_RELEASE >= 202
  summary->linear_solver_ordering_type = options.linear_solver_ordering_type;
#endif
}

/// Whether this Ceres was built with its Schur eliminators for fixed block sizes, as it is by
/// default.
#ifdef CERES_RESTRICT_SCHUR_SPECIALIZATION
constexpr bool kCeresHasSchurSpecializations = false;
#else
constexpr bool kCeresHasSchurSpecializations = true;
#endif

/// Bounds of a block as Ceres sees them.
enum class BoundsKind {
  kNone,     ///< no value is bounded
  kBounded,  ///< some value is bounded
  /// nothing can be done: a constant lies outside, or a lower bound is not below its upper bound
  kInfeasible,
};

/// Appends the block's lower bounds, then its upper bounds, to *bounds if any value is bounded. Two
/// map lookups a value: Ceres has no cheaper question. Unbounded is ∓max; infinities set by the
/// user are unbounded too, and so is NaN, as in Ceres.
inline BoundsKind ReadBounds(const ceres::Problem& problem, const double* values, int size,
                             bool constant, std::vector<double>* bounds) {
  constexpr double kMax = std::numeric_limits<double>::max();
  const auto count = static_cast<std::size_t>(size);
  const std::size_t first = bounds->size();
  BoundsKind kind = BoundsKind::kNone;
  for (int i = 0; i < size; ++i) {
    const double lower = problem.GetParameterLowerBound(values, i);
    const double upper = problem.GetParameterUpperBound(values, i);
    const bool infeasible = constant ? values[i] < lower || values[i] > upper : lower >= upper;
    if (kind == BoundsKind::kNone && (infeasible || lower > -kMax || upper < kMax)) {
      kind = BoundsKind::kBounded;
      bounds->resize(first + count, -kMax);
      bounds->resize(first + 2 * count, kMax);
    }
    if (kind != BoundsKind::kNone) {
      double* const pair = bounds->data() + first + i;
      pair[0] = std::isnan(lower) ? -kMax : lower;
      pair[count] = std::isnan(upper) ? kMax : upper;
    }
    kind = infeasible ? BoundsKind::kInfeasible : kind;
  }
  return kind;
}

}  // namespace inceres::internal
