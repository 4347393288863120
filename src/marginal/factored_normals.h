#pragma once

#include <memory>
#include <vector>

#include <Eigen/Core>

#include "base/executor.h"
#include "inceres/solver/covariance.h"
#include "linear/sparse_cholesky.h"
#include "linearize/evaluator.h"
#include "marginal/orthogonal_elimination.h"
#include "schur/direct_elimination.h"

namespace inceres::internal {

/// The undamped normal equations of a graph at a state, landmarks eliminated, and a Cholesky factor
/// of their S; of kQr the same from the Jacobian, which is never squared. Whatever is not
/// determined is found out and named: a factor of a singular S often exists, thanks to rounding,
/// and so does an S of which landmarks have left nothing else.
class FactoredNormals {
 public:
  /// `keeps_jacobians`: whether they are there after Factorize.
  FactoredNormals(const FactorGraph& graph, const std::vector<double>& state,
                  const CovarianceOptions& options, bool keeps_jacobians);

  /// Linearizes, eliminates and factors. kSingular names a variable that is not determined.
  Status Factorize();
  /// left := S⁻¹ right, column by column.
  Status Solve(const Eigen::MatrixXd& right, Eigen::MatrixXd* left);
  /// Of a frame's coordinate: kSingular if its variance is that of rounding.
  Status CheckVariance(int frame, int k, double variance);
  /// What has been found to be open.
  const RankDeficiency& deficiency() const { return deficiency_; }

  const FactorGraph& graph() const { return graph_; }
  const Executor& executor() const { return executor_; }
  const Layout& layout() const { return layout_; }
  const Evaluator& evaluator() const { return evaluator_; }
  const LandmarkIncidences& incidences() const { return incidences_; }
  const BlockPattern& pattern() const { return elimination_.pattern(); }
  const DirectElimination& elimination() const { return elimination_; }
  const SparseCholesky& factor() const { return factor_; }
  /// Null but of kQr.
  OrthogonalElimination* by_rows() const { return by_rows_.get(); }

 private:
  Status FactorizeRows();
  Status EliminateByRows(double least, std::vector<RowsOfBlocks>* rows,
                         std::vector<double>* inflations);
  void AddSquares(const RowsOfBlocks& rows);
  Eigen::VectorXd ColumnSquares(const std::vector<double>& weights) const;
  double MostRounding() const;
  Status NameOpen(const std::vector<int>& landmarks);
  Status CheckGauge();
  Status Probe(const Eigen::VectorXd& diagonal, double most);
  Status NotDetermined(VariableId id, const char* why);
  VariableId FrameWith(Eigen::Index scalar) const;
  void FindDirections();
  RankDeficiency::Direction SharesOf(const Eigen::VectorXd& squares) const;

  const FactorGraph& graph_;
  const CovarianceOptions& options_;
  Executor executor_;
  Layout layout_;
  Evaluator evaluator_;
  LandmarkIncidences incidences_;
  DirectElimination elimination_;
  SparseCholesky factor_;
  // What variances are held against: of C, of kQr of S.
  Eigen::VectorXd diagonal_;
  // E: diag(C) with the squares of each landmark's rows times the landmark's inflation. S_kk is
  // exact to ε E_k, by rows to ε² E_k.
  Eigen::VectorXd rounding_;
  std::unique_ptr<OrthogonalElimination> by_rows_;  // of kQr
  RankDeficiency deficiency_;
};

}  // namespace inceres::internal
