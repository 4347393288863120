#include "linear/pending_rows.h"

#include <algorithm>

#include <Eigen/LU>

namespace inceres::internal {

// Products with S⁻¹ from the factor of an S of before (docs/algorithms.md, "From a live factor").
// Matrices are so small that products entry by entry are the quickest.
// Of the columns V the new rows V_N are eliminated, V̂ = V_R − E_T B C⁻¹ V_N, and then
//
//     VᵀS⁻¹V = V_NᵀC⁻¹V_N + V̂ᵀA⁻¹V̂ − H (I + K G)⁻¹ K Hᵀ,    H = V̂ᵀA⁻¹E_T,    G = E_TᵀA⁻¹E_T.
//
// Its error is that of a factor of S itself, but where a variance falls far below the one that it
// is the difference from: then the tree is to be renewed.

namespace {

using Eigen::MatrixXd;

// Scalars of T and N together: dense work on these is then less than that on the cliques between
// them and the root, which they would make stale.
constexpr int kMostPending = 24;
// Below this share of the variance that changes are subtracted from: four of sixteen digits are
// gone.
constexpr double kLeastLeft = 1e-4;

}  // namespace

// Null: the row is not pending.
const PendingRows::Place* PendingRows::Find(int row) const {
  const auto at = std::lower_bound(places_.begin(), places_.end(), row,
                                   [](const Place& place, int r) { return place.row < r; });
  return at != places_.end() && at->row == row ? &*at : nullptr;
}

bool PendingRows::ListPlaces(const SymmetricBlockRows& S, const BayesTree& tree,
                             const std::vector<int>& rows) {
  places_.clear();
  tree_size_ = new_size_ = 0;
  for (const int row : rows) {
    const bool is_in_tree = tree.tree().Has(row);
    int& size = is_in_tree ? tree_size_ : new_size_;
    places_.push_back({row, is_in_tree, size});
    size += S.size_of(row);
    if (tree_size_ + new_size_ > kMostPending) {
      return false;
    }
  }
  return true;
}

// A block between a pending row and another must be as it was; one between two of them goes where
// it belongs, of the tree's own less what is in the factor. Values are compared, padding included:
// a block that was only summed anew to the same values has not changed. Δ, the difference to what
// was factored, goes into K_, from which B C⁻¹ Bᵀ is taken later; blocks of T that the factor did
// not have count as zeros there.
bool PendingRows::AddBlock(const SymmetricBlockRows& S, const BayesTree& tree, int row, int column,
                           MatrixXd* C) {
  const Place *a = Find(row), *b = Find(column);
  const std::int64_t offset = S.Find(row, column);
  const double* known = tree.FactoredBlock(row, column, offset);
  const int rows = S.size_of(row), columns = S.size_of(column), stride = PadToQuad(columns);
  const double* block = S.values(offset);
  if (a == nullptr || b == nullptr) {
    return known != nullptr && std::equal(known, known + rows * stride, block);
  }
  for (int i = 0; i < rows; ++i) {
    // Of a block on the diagonal the lower triangle counts.
    for (int j = 0; j < (row == column ? i + 1 : columns); ++j) {
      const double value = block[i * stride + j];
      const int at = a->begin + i, other = b->begin + j;
      if (a->is_in_tree && b->is_in_tree) {
        K_(at, other) = K_(other, at) = value - (known != nullptr ? known[i * stride + j] : 0.0);
      } else if (!a->is_in_tree && !b->is_in_tree) {
        (*C)(at, other) = (*C)(other, at) = value;
      } else {
        B_(a->is_in_tree ? at : other, a->is_in_tree ? other : at) = value;
      }
    }
  }
  return true;
}

// All or nothing: what was filled in before it says no is never used. C is a block of S, and
// definite where S is.
bool PendingRows::TakeUp(const SymmetricBlockRows& S, const BayesTree& tree,
                         const std::vector<int>& rows) {
  if (!ListPlaces(S, tree, rows)) {
    return false;
  }
  K_.setZero(tree_size_, tree_size_);
  B_.setZero(tree_size_, new_size_);
  MatrixXd C = MatrixXd::Zero(new_size_, new_size_);
  for (const int row : rows) {
    for (const SymmetricBlockRows::Entry& entry : S.row(row)) {
      if (!AddBlock(S, tree, row, entry.column, &C)) {
        return false;
      }
    }
    for (const int below : S.below(row)) {
      // Of two pending rows the later one has the block among its own.
      if (Find(below) == nullptr && !AddBlock(S, tree, below, row, &C)) {
        return false;
      }
    }
  }
  C_.compute(C);
  if (new_size_ > 0 && C_.info() != Eigen::Success) {
    return false;
  }
  C_inv_Bt_ = C_.solve(B_.transpose());
  K_.noalias() -= B_.lazyProduct(C_inv_Bt_);
  SolveForTree(tree.tree());
  return true;
}

// Along the odometry T is the pose that new ones began at: it stays. G = E_TᵀA⁻¹E_T and L⁻¹E_T
// depend on the factor and on T alone, not on what was added, so they stay while T does. They cost
// the cliques from T to the root.
void PendingRows::SolveForTree(const CliqueTree& tree) {
  SparseColumns E_T;
  E_T.values.setIdentity(tree_size_, tree_size_);
  for (const Place& place : places_) {
    if (place.is_in_tree) {
      E_T.rows.push_back(place.row);
      E_T.begin.push_back(place.begin);
    }
  }
  if (tree_rows_ != E_T.rows) {
    tree_paths_ = ForwardPaths(tree, E_T);
    G_ = tree_paths_.InnerProducts(tree_paths_).topLeftCorner(tree_size_, tree_size_);
    tree_rows_ = E_T.rows;
  }
}

// V̂ has the rows of T, V_T − B C⁻¹ V_N here, and others that V has, which are substituted by
// themselves: products of both are summed as cross and square terms of V̂ᵀA⁻¹V̂. V_N becomes
// L_C⁻¹V_N in its place, whose square is V_NᵀC⁻¹V_N. I + K G is small and not symmetric, hence LU
// with pivots. The result is made symmetric, for its rounding is not.
Status PendingRows::Product(const SparseColumns& V, const std::vector<int>& offsets,
                            const CliqueTree& tree, MatrixXd* product) const {
  const Eigen::Index k = V.values.cols();
  // V by rows of N, of T, and others.
  MatrixXd V_N = MatrixXd::Zero(new_size_, k), V_T = MatrixXd::Zero(tree_size_, k);
  SparseColumns others;
  for (std::size_t r = 0; r < V.rows.size(); ++r) {
    const Place* place = Find(V.rows[r]);
    const int size = offsets[V.rows[r] + 1] - offsets[V.rows[r]];
    if (place == nullptr) {
      others.rows.push_back(V.rows[r]);
      others.begin.push_back(V.begin[r]);
    } else {
      (place->is_in_tree ? V_T : V_N).middleRows(place->begin, size) =
          V.values.middleRows(V.begin[r], size);
    }
  }
  V_T.noalias() -= C_inv_Bt_.transpose().lazyProduct(V_N);
  C_.matrixL().solveInPlace(V_N);
  MatrixXd H = V_T.transpose().lazyProduct(G_);
  *product = H.lazyProduct(V_T) + V_N.transpose().lazyProduct(V_N);
  if (!others.rows.empty()) {
    others.values = V.values;
    const ForwardPaths y(tree, others);
    const MatrixXd cross = y.InnerProducts(tree_paths_).topLeftCorner(k, tree_size_);
    const MatrixXd from_T = cross.lazyProduct(V_T);
    *product += y.InnerProducts(y).topLeftCorner(k, k) + from_T + from_T.transpose();
    H += cross;
  }
  const Eigen::VectorXd before = product->diagonal();
  if (tree_size_ > 0) {
    MatrixXd I_KG = K_.lazyProduct(G_);
    I_KG.diagonal().array() += 1.0;
    const MatrixXd K_Ht = K_.lazyProduct(H.transpose());
    product->noalias() -= H.lazyProduct(I_KG.partialPivLu().solve(K_Ht).eval());
  }
  *product = (0.5 * (*product + product->transpose())).eval();
  // Also false of a NaN.
  return (product->diagonal().array() >= kLeastLeft * before.array()).all()
             ? Status::Ok()
             : Status::Error(StatusCode::kUnavailable, "the factor is too old");
}

}  // namespace inceres::internal
