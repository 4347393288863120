#pragma once

#include <string>
#include <vector>

#include <ceres/solver.h>

#include "inceres/ceres/solve.h"
#include "integration/problems.h"

namespace inceres::test {

/// How stock Ceres solves its linear systems: what may differ without changing the mathematics.
struct Configuration {
  ceres::LinearSolverType linear_solver = ceres::DENSE_SCHUR;
  bool landmarks_first = false;  ///< an explicit ordering in place of the automatic one
  ceres::DenseLinearAlgebraLibraryType dense = ceres::EIGEN;
  ceres::SparseLinearAlgebraLibraryType sparse = ceres::SUITE_SPARSE;
};

/// Who solves.
enum class Who { kStock, kInceres };

/// Silent options with the strategy, one thread, tolerances at Ceres's defaults and iterations
/// enough to reach them.
ceres::Solver::Options DefaultOptions(ceres::TrustRegionStrategyType strategy);
/// The same with all three tolerances 0: exactly `num_iterations` steps, unless one changes
/// nothing.
ceres::Solver::Options ZeroToleranceOptions(ceres::TrustRegionStrategyType strategy,
                                            int num_iterations);

/// One solve and the state it ended in.
struct Solved {
  ceres::Solver::Summary summary;
  std::vector<double> x;
};

/// Solves `instance` where it stands; its `x` is the result. A test failure if the shim hands the
/// problem to stock Ceres or eliminates other landmarks than the instance's.
ceres::Solver::Summary Solve(Who who, const Configuration& configuration,
                             ceres::Solver::Options options, Instance* instance);

/// Builds the problem anew and solves it.
Solved Solve(Who who, const Configuration& configuration, const ceres::Solver::Options& options,
             const Factory& make, const tools::LossSpec& loss);

/// |a − b| relative to the larger; 0 if both are the same number.
double RelativeDifference(double a, double b);

/// A measured difference, for RecordProperty: "3.2e-12".
std::string Printed(double difference);

/// Largest |a_k − b_k| / (1 + |a_k|).
double LargestDifference(const std::vector<double>& a, const std::vector<double>& b);

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
