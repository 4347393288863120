#pragma once

#include <map>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"
#include "linearize/evaluator.h"
#include "linearize/hessian.h"
#include "schur/elimination.h"

namespace inceres::internal {

/// The undamped normal equations of a graph at a state, factored, and columns of their inverse.
class CovarianceSystem {
 public:
  CovarianceSystem(const FactorGraph& graph, const std::vector<double>& state, int num_threads,
                   double max_inflation);

  /// Linearizes, eliminates and factors. kSingular names a variable that is not determined.
  Status Factorize();
  bool Has(VariableId id) const { return layout_.position[id] >= 0; }

  /// Makes V and X = S⁻¹ V of a variable; V of others must have been prepared before they meet it
  /// in a Product.
  Status Prepare(const std::vector<VariableId>& ids);
  /// cov(a, b) of two prepared variables.
  Eigen::MatrixXd Product(VariableId a, VariableId b) const;

 private:
  struct Column {
    Eigen::MatrixXd V;      // frame size × tangent size
    Eigen::MatrixXd X;      // S⁻¹ V
    Eigen::MatrixXd P_inv;  // of landmarks
  };

  Status CheckLandmarks();
  Status CheckGauge();
  Status NotDetermined(VariableId id, const char* why) const;
  Eigen::VectorXd DiagonalOfS() const;
  Status Solve(const Eigen::MatrixXd& right, Eigen::MatrixXd* left);
  void SubtractW();

  const FactorGraph& graph_;
  const double max_inflation_;
  Executor executor_;
  Layout layout_;
  Evaluator evaluator_;
  LandmarkIncidences incidences_;
  FramePlans plans_;
  Hessian hessian_;
  Elimination elimination_;
  std::unique_ptr<ReducedSolver> solver_;
  std::map<VariableId, Column> columns_;
};

}  // namespace inceres::internal
