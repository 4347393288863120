#pragma once

#include <vector>

#include <Eigen/Core>

#include "incremental/live_columns.h"
#include "linearize/evaluator.h"

namespace inceres::internal {

/// The undamped normal equations H x = e at the values a system holds, all factors linearized anew
/// and none factored: by conjugate gradients with what the system has as preconditioner. Where that
/// is H but for its damping a few iterations do; each costs a pass over the Jacobians, one over the
/// landmarks and two substitutions. Threads: evaluation on the system's, all else on the calling
/// one. Source: Hestenes & Stiefel 1952.
class ExactCovariance {
 public:
  ExactCovariance(const FactorGraph& graph, const IncrementalSystem& system,
                  const LiveFactor& factor);

  Status Linearize();
  /// The joint covariance of these variables: Σ_ij = e_iᵀx_j + x_iᵀr_j with r = e − H x, whose
  /// error is the product of those of x_i and x_j in the norm of the energy.
  Status Compute(const std::vector<VariableId>& ids, double tolerance, int max_iterations,
                 Eigen::MatrixXd* joint);
  int num_iterations() const { return num_iterations_; }

 private:
  using Vector = Eigen::VectorXd;

  Vector Product(const Vector& v) const;
  Status Solve(double tolerance, int max_iterations, Vector* r, Vector* x);

  const FactorGraph& graph_;
  const IncrementalSystem& system_;
  const LiveFactor& factor_;
  Layout layout_;
  Evaluator evaluator_;
  std::vector<std::int32_t> quad_of_;  // of the system's vectors, per quad of the layout's
  int num_iterations_ = 0;
};

}  // namespace inceres::internal
