#pragma once

#include <vector>

#include <Eigen/Core>

#include "inceres/problem/factor_graph.h"

namespace inceres::test {

/// The variables that are there and not constant.
std::vector<VariableId> MovingVariables(const FactorGraph& graph);

/// The linearized problem written out as matrices, straight from the graph: families evaluated one
/// by one, Jacobians projected by products with the manifolds' PlusJacobian, losses applied as
/// Triggs writes them. Shares no code with src/. Free places of an edited graph are rows of zeros;
/// pins are not looked at.
struct DenseOracle {
  /// The columns are those of `variables`, one after the other; every other variable counts as
  /// constant.
  DenseOracle(const FactorGraph& graph, const std::vector<VariableId>& variables);

  double cost = 0.0;  // ½ Σ ρ
  Eigen::MatrixXd J;  // after the correction for the loss
  Eigen::VectorXd f;
  Eigen::MatrixXd H;  // JᵀJ
  Eigen::VectorXd g;  // Jᵀf
};

/// ½ Σ ρ at a state vector.
double CostAt(const FactorGraph& graph, const std::vector<double>& state);

/// ‖actual − expected‖ / ‖expected‖, or ‖actual‖ if nothing is expected.
double RelativeError(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected);

}  // namespace inceres::test
