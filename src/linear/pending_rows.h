#pragma once

#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "inceres/status.h"
#include "linear/bayes_tree.h"
#include "linear/forward_paths.h"

namespace inceres::internal {

/// The few rows of S that have changed since a Bayes tree factored it, for products with S⁻¹ of now
/// from the factor of then: a pose that has come along the odometry renews no clique. With T the
/// changed rows that the tree has, and N those that it does not have yet,
///
///     S = | A + E_T Δ E_Tᵀ   E_T B |      S of now
///         | Bᵀ E_Tᵀ          C     |      A of then
///
/// and N eliminated, K = Δ − B C⁻¹ Bᵀ is all that is added to A.
/// Cost of Product: that of LiveFactor's, and dense work on T and N. L⁻¹E_T is kept as long as T is
/// the same.
/// Source: Woodbury's identity, Golub & Van Loan, "Matrix Computations", section 2.1.4.
class PendingRows {
 public:
  /// Takes up S. False if the tree has to be renewed first: these rows are many, or are coupled in
  /// another way to rows that are not among them, or C is not definite. `rows` ascend; they are all
  /// that have changed, none of them was held, and no block was removed.
  bool TakeUp(const SymmetricBlockRows& S, const BayesTree& tree, const std::vector<int>& rows);

  /// Vᵀ S⁻¹ V. kUnavailable: a variance falls by so much that it is left with few digits.
  Status Product(const SparseColumns& V, const std::vector<int>& offsets, const CliqueTree& tree,
                 Eigen::MatrixXd* product) const;
  /// The tree was factored anew, and nothing is pending.
  void Forget() { *this = PendingRows(); }

 private:
  // Where a pending row begins among the scalars of T or of N.
  struct Place {
    int row;
    bool is_in_tree;
    int begin;
  };
  const Place* Find(int row) const;
  bool ListPlaces(const SymmetricBlockRows& S, const BayesTree& tree, const std::vector<int>& rows);
  bool AddBlock(const SymmetricBlockRows& S, const BayesTree& tree, int row, int column,
                Eigen::MatrixXd* C);
  void SolveForTree(const CliqueTree& tree);

  std::vector<Place> places_;  // by row
  int tree_size_ = 0, new_size_ = 0;
  Eigen::MatrixXd K_, B_;
  Eigen::LLT<Eigen::MatrixXd> C_;
  Eigen::MatrixXd C_inv_Bt_;
  std::vector<int> tree_rows_;  // T that these are of: L⁻¹E_T, and G
  ForwardPaths tree_paths_;
  Eigen::MatrixXd G_;
};

}  // namespace inceres::internal
