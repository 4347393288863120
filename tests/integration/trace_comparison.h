#pragma once

#include <ceres/solver.h>

namespace inceres::test {

/// How far two solves of the same problem are apart, over the iterations both have.
struct TraceDifference {
  bool same_decisions = true;  ///< accepted the same steps
  double cost = 0.0;           ///< largest relative difference of the costs
  double radius = 0.0;         ///< largest relative difference of the trust region radii
};
TraceDifference CompareTraces(const ceres::Solver::Summary& a, const ceres::Solver::Summary& b);

/// Smallest change of the cost by a step, relative to the cost. Where it comes near rounding, the
/// relative decrease, the decision and the next radius hang on the last digits of the cost.
double SmallestChange(const ceres::Solver::Summary& summary);

/// Smallest distance of the relative decreases from the values at which the strategies decide:
/// 0.001; 0.25 and 0.75 for Dog-Leg. Where it comes near rounding, two solvers may decide
/// differently and both be right.
double DistanceFromThresholds(const ceres::Solver::Summary& summary);

}  // namespace inceres::test
