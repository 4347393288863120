#pragma once

#include <vector>

#include <Eigen/Core>

#include "inceres/problem/factor_graph.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/status.h"

namespace inceres::internal {

/// What suspects that weigh nothing yet would do to a living solution (docs/algorithms.md,
/// "Graduated non-convexity", foresight): their errors for any weights, to first order, without a
/// solve. With f of all suspects one below the other, J their Jacobians and Σ the joint covariance
/// of their variables, the solution with the weights W has f(W) = (I + J Σ Jᵀ W)⁻¹ f.
class Foresight {
 public:
  /// At the solution of the last Update, in which the suspects have weight 0. Fails where there is
  /// no covariance, or as the factors or manifolds do.
  Status Prepare(const IncrementalSolver& solver, const std::vector<FactorId>& suspects);
  /// ‖f‖² of each with these weights. Cost: the cube of all residuals' size.
  std::vector<double> SquaredErrors(const std::vector<double>& weights) const;

 private:
  void ListVariables(const FactorGraph& graph, const std::vector<FactorId>& suspects);
  Status Linearize(const IncrementalSolver& solver, const std::vector<FactorId>& suspects,
                   const std::vector<int>& columns, Eigen::MatrixXd* J);

  std::vector<VariableId> variables_;  // that move, each once
  std::vector<int> begin_;             // of each suspect's rows; one more
  Eigen::VectorXd f_;
  Eigen::MatrixXd spread_;  // J Σ Jᵀ
};

}  // namespace inceres::internal
