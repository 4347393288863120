#pragma once

#include <map>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "base/executor.h"
#include "inceres/solver/covariance.h"
#include "linear/selected_inverse.h"
#include "linear/sparse_cholesky.h"
#include "linearize/evaluator.h"
#include "linearize/hessian.h"
#include "marginal/orthogonal_elimination.h"
#include "schur/elimination.h"

namespace inceres::internal {

/// The undamped normal equations of a graph at a state, factored, and blocks of their inverse; of
/// kQr the same from the Jacobian, which is never squared. With
/// V of a variable as GraphCovariance defines it, which touches few frames, a block is a sum over
/// these:
///
///     cov(a, b) = Σ_ij V_aiᵀ (S⁻¹)_ij V_bj + [a = b is a landmark] P_b⁻¹.
///
/// The blocks of S⁻¹ come from the factor (SelectedInverse) where that takes less than solving for
/// the columns of all that is wanted, and where the factor has them; else from solves.
class CovarianceSystem {
 public:
  CovarianceSystem(const FactorGraph& graph, const std::vector<double>& state,
                   const CovarianceOptions& options);

  /// Linearizes, eliminates and factors. kSingular names a variable that is not determined.
  Status Factorize();
  bool Has(VariableId id) const { return layout_.position[id] >= 0; }
  /// What Factorize or Prepare has found to be open.
  const RankDeficiency& deficiency() const { return deficiency_; }

  /// Makes ready what Product needs for these pairs, of variables that it Has.
  Status Prepare(const GraphCovariance::Pairs& pairs);
  /// cov(a, b) of one of the pairs.
  Eigen::MatrixXd Product(VariableId a, VariableId b) const;

 private:
  struct Column {
    std::vector<int> frames;
    std::vector<int> rows;  // of V, where each of these begins
    Eigen::MatrixXd V;      // rows of these frames × tangent size
    Eigen::MatrixXd P_inv;  // of landmarks
    Eigen::MatrixXd X;      // S⁻¹ V, where it was solved for
  };

  Status FactorizeRows();
  Status EliminateByRows(double least, std::vector<RowsOfBlocks>* rows);
  void AddSquares(const RowsOfBlocks& rows);
  void MakeColumnByRows(int landmark, Column* column);
  Status CheckLandmarks();
  Status CheckGauge();
  Status CheckVariance(int frame, int k, double variance);
  Status NotDetermined(VariableId id, const char* why);
  void FindDirections();
  Eigen::VectorXd DiagonalOfS() const;
  void MakeColumn(VariableId id);
  void SubtractW();
  Status Solve(const Eigen::MatrixXd& right, Eigen::MatrixXd* left);
  Status SolveFor(VariableId id);
  Status InvertFactor();
  Status SolveForPairs(const GraphCovariance::Pairs& pairs);
  bool IsSelected(const Column& a, const Column& b) const;
  Eigen::MatrixXd FromSolution(const Column& a, const Column& b) const;
  Eigen::MatrixXd FromInverse(const Column& a, const Column& b) const;

  const FactorGraph& graph_;
  const CovarianceOptions& options_;
  Executor executor_;
  Layout layout_;
  Evaluator evaluator_;
  LandmarkIncidences incidences_;
  FramePlans plans_;
  Hessian hessian_;
  Elimination elimination_;
  SparseCholesky factor_;
  Eigen::VectorXd diagonal_;                        // of S
  std::unique_ptr<OrthogonalElimination> by_rows_;  // of kQr
  std::unique_ptr<SelectedInverse> inverse_;
  std::map<VariableId, Column> columns_;
  RankDeficiency deficiency_;
};

}  // namespace inceres::internal
