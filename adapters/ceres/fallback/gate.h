#pragma once

#include <string>

#include <ceres/evaluation_callback.h>
#include <ceres/solver.h>

#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"

namespace inceres::internal {

/// Largest Jacobian, rows × columns with the damping rows, that DENSE_QR is solved for here: 32 MB.
/// Above it the problem goes to stock Ceres; QR is never replaced by normal equations.
inline constexpr double kMaxDenseQrEntries = 4.0 * 1024 * 1024;

/// Why these options cannot be honored here, or an empty string. Looks at nothing but the options.
std::string OptionsObstacle(const ceres::Solver::Options& options);

/// Why this problem cannot be solved here under these options, or an empty string. Nothing of the
/// user's has been called yet.
std::string ProblemObstacle(const ceres::Solver::Options& options, const ProblemView& view,
                            const OrderingView& ordering);

/// Its part: DENSE_QR, asked for or what an empty group of landmarks makes of a Schur solver, of
/// too large a Jacobian.
std::string DenseQrObstacle(const ceres::Solver::Options& options, const ProblemView& view,
                            const OrderingView& ordering);

/// The same two questions for incremental mode: what exact mode cannot do either, and what only it
/// can. `evaluation_callback` is the problem's, or null.
std::string IncrementalOptionsObstacle(
    const ceres::Solver::Options& options,
    const ceres::EvaluationCallback* evaluation_callback = nullptr);
std::string IncrementalProblemObstacle(const ceres::Solver::Options& options,
                                       const ProblemView& view, const OrderingView& ordering);

/// Reads the problem and asks both questions: why it cannot be solved here, or an empty string.
/// `view` and `ordering` are filled unless the options alone are an obstacle.
std::string FindObstacle(const ceres::Solver::Options& options, const ceres::Problem& problem,
                         bool incremental, const ceres::EvaluationCallback* evaluation_callback,
                         ProblemView* view, OrderingView* ordering);

}  // namespace inceres::internal
