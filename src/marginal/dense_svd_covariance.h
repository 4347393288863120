#pragma once

#include <vector>

#include <Eigen/Core>

#include "base/executor.h"
#include "inceres/solver/covariance.h"
#include "linearize/evaluator.h"

namespace inceres::internal {

/// (JᵀJ)⁻¹ of a graph at a state by the singular values of J, dense: V Σ⁻² Vᵀ, without those that
/// CovarianceOptions leaves out, which makes it the Moore–Penrose inverse. What no factor touches
/// are columns of zeros. Cost: m n² for m residuals and n degrees of freedom; memory 2 m n.
/// Threads: those of the options evaluate. Source: Golub & Van Loan, sections 5.5.2 and 8.6; the
/// rank rule is that of Ceres 2.1, covariance_impl.cc.
class DenseSvdCovariance {
 public:
  DenseSvdCovariance(const FactorGraph& graph, const std::vector<double>& state,
                     const CovarianceOptions& options);

  bool Has(VariableId id) const { return layout_.position[id] >= 0; }
  /// Of all pairs, whichever are wanted. kSingular where more singular values are small than may be
  /// left out.
  Status Factorize(const GraphCovariance::Pairs& pairs);
  /// cov(a, b) of variables that it Has.
  Eigen::MatrixXd Product(VariableId a, VariableId b) const;

 private:
  Eigen::MatrixXd DenseJacobian() const;
  Eigen::MatrixXd RowsOf(VariableId id) const;

  const FactorGraph& graph_;
  const CovarianceOptions& options_;
  Executor executor_;
  Layout layout_;
  Evaluator evaluator_;
  Eigen::MatrixXd root_;  // V Σ⁻¹ of what is kept
};

}  // namespace inceres::internal
