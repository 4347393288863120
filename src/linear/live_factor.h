#pragma once

#include <vector>

#include <Eigen/Core>

#include "inceres/linear/reduced_solver.h"
#include "linear/bayes_tree.h"
#include "linear/forward_paths.h"
#include "linear/resumed_solver.h"

namespace inceres::internal {

/// The factor A = L Lᵀ that a resuming solver holds between its calls, for products with A⁻¹
/// beside its own solves, of which it forgets nothing: covariances. With V of few block rows,
///
///     Vᵀ A⁻¹ V = (L⁻¹V)ᵀ (L⁻¹V),
///
/// and L⁻¹V is zero but in the cliques between those rows and the root of the Bayes tree, or in the
/// envelope from the first of them on: no substitution backwards, and of the factor only that path.
/// Cost of Product: that of a forward substitution along it, a column. Threads: the calling one.
/// Source: Kaess & Dellaert, "Covariance recovery from a square root information matrix for data
/// association", RAS 57(12), 2009, of which this is the half that marginals need.
class LiveFactor {
 public:
  /// Of this solver, which may be null, as long as it is not told to factor again. Dense and batch
  /// sparse factors have no shorter way than a solve for each column.
  explicit LiveFactor(ReducedSolver* solver);
  explicit LiveFactor(const BayesTree& tree) : tree_(&tree) {}

  /// Whether there is one to speak of: not of conjugate gradients, nor of a user's solver.
  bool exists() const { return tree_ != nullptr || resumed_ != nullptr || other_ != nullptr; }
  /// Vᵀ A⁻¹ V, symmetric. `offsets`: first scalar of each row of S in packed vectors, one more.
  Status Product(const SparseColumns& V, const std::vector<int>& offsets,
                 Eigen::MatrixXd* product) const;
  /// x = A⁻¹ b, packed by rows of S.
  Status Solve(const std::vector<int>& offsets, const double* b, double* x) const;

 private:
  Eigen::MatrixXd EnvelopeProduct(const SparseColumns& V) const;
  void SolveByTree(const std::vector<int>& offsets, const double* b, double* x) const;
  void SolveByEnvelope(const std::vector<int>& offsets, const double* b, double* x) const;

  const BayesTree* tree_ = nullptr;
  const ResumedSolver* resumed_ = nullptr;
  ReducedSolver* other_ = nullptr;  // that remembers nothing from one Solve to the next
};

}  // namespace inceres::internal
