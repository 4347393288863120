#include "adapters/ceres/fallback/gate.h"

namespace inceres::internal {

void SolveWithStock(const ceres::Solver::Options& options, ceres::Problem* problem,
                    ceres::Solver::Summary* summary) {
  ceres::Solver solver;
  solver.Solve(options, problem, summary);
}

}  // namespace inceres::internal
