#pragma once

#include <functional>
#include <string>

#include <ceres/evaluation_callback.h>
#include <ceres/solver.h>

#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "src/base/available_memory.h"

namespace inceres::internal {

/// Up to here nobody asks whether there is memory for DENSE_QR.
inline constexpr double kMaxUncheckedQrBytes = 64.0 * 1024 * 1024;

/// Why these options cannot be honored here, or an empty string. Looks at nothing but the options.
std::string OptionsObstacle(const ceres::Solver::Options& options);

/// Why this problem cannot be solved here under these options, or an empty string. Nothing of the
/// user's has been called yet.
std::string ProblemObstacle(const ceres::Solver::Options& options, const ProblemView& view,
                            const OrderingView& ordering);

/// Its part: DENSE_QR, asked for or what an empty group of landmarks makes of a Schur solver, of a
/// Jacobian for which there is no memory. Then the problem goes to stock Ceres: QR is never
/// replaced by normal equations.
std::string DenseQrObstacle(const ceres::Solver::Options& options, const ProblemView& view,
                            const OrderingView& ordering,
                            const AvailableMemory& available = AvailableBytes);

/// What these options, or bounds of this problem, ask of a solve in incremental mode that only
/// exact mode has: its reason for being exact, or an empty string. `evaluation_callback` is the
/// problem's, or null. Of a bounded block on a manifold Plus and PlusJacobian are called, once
/// each, to see what they do.
std::string NeedsExactMode(const ceres::Solver::Options& options,
                           const ceres::EvaluationCallback* evaluation_callback);
std::string NeedsExactMode(const ProblemView& view);

/// Asks all questions: why the problem cannot be solved here, or an empty string. `look` reads it
/// into the view, unless the options alone are an obstacle; the ordering is read then too.
/// *exact_reason: why a solve in incremental mode is to be exact, or empty. What calls code of the
/// user's (NeedsExactMode of a view) is asked last, and not of a problem that no mode solves.
std::string FindObstacle(const ceres::Solver::Options& options, bool incremental,
                         const ceres::EvaluationCallback* evaluation_callback,
                         const std::function<void()>& look, const ProblemView& view,
                         OrderingView* ordering, std::string* exact_reason);

}  // namespace inceres::internal
