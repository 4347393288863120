#include "linear/live_factor.h"

#include <algorithm>
#include <cstddef>

#include "linear/automatic_solver.h"
#include "linear/dense_cholesky.h"
#include "linear/front_elimination.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

// Products with A⁻¹ from the factor that a solver holds (docs/algorithms.md, "From a live factor").
// VᵀA⁻¹V = (L⁻¹V)ᵀ(L⁻¹V) is symmetric by its form, needs the forward half only, and is a sum of
// squares on the diagonal: a variance cannot come out negative. L⁻¹V has entries only where the
// columns of V reach: in the Bayes tree the paths from their cliques to the root, in the envelope
// everything from the first of their rows on.
//
// All vectors are copies. The solver's own y and x, by which it resumes, are not touched.

namespace {

using Eigen::MatrixXd;

}  // namespace

LiveFactor::LiveFactor(ReducedSolver* solver) {
  // Its two solvers take turns: the one that took the last factorization has the factor of today.
  if (const auto* automatic = dynamic_cast<AutomaticSolver*>(solver)) {
    solver = automatic->chosen();
  }
  // At most one of the three is set. Of another solver, such as conjugate gradients, none is: there
  // is no factor.
  tree_ = dynamic_cast<BayesTree*>(solver);
  resumed_ = dynamic_cast<ResumedSolver*>(solver);
  // Solve of these two remembers no b and no x, so it may be called between the solves of others.
  const bool is_stateless = dynamic_cast<DenseCholesky*>(solver) != nullptr ||
                            dynamic_cast<SparseCholesky*>(solver) != nullptr;
  other_ = is_stateless ? solver : nullptr;
}

Status LiveFactor::Product(const SparseColumns& V, const std::vector<int>& offsets,
                           MatrixXd* product) const {
  if (tree_ != nullptr) {
    const ForwardPaths y(tree_->tree(), V);
    *product = y.InnerProducts(y).topLeftCorner(V.values.cols(), V.values.cols());
    return Status::Ok();
  }
  if (resumed_ != nullptr) {
    *product = EnvelopeProduct(V);
    return Status::Ok();
  }
  // Without a factor to look into: a solve for each column, and the product made symmetric.
  MatrixXd right = MatrixXd::Zero(offsets.back(), V.values.cols());
  for (std::size_t k = 0; k < V.rows.size(); ++k) {
    const int size = offsets[V.rows[k] + 1] - offsets[V.rows[k]];
    right.middleRows(offsets[V.rows[k]], size) = V.values.middleRows(V.begin[k], size);
  }
  MatrixXd left(right.rows(), right.cols());
  Status status;
  for (Eigen::Index c = 0; status.ok() && c < right.cols(); ++c) {
    status = Solve(offsets, right.col(c).data(), left.col(c).data());
  }
  const MatrixXd whole = right.transpose() * left;
  *product = 0.5 * (whole + whole.transpose());
  return status;
}

// Before the first row y is zero, so the product of what is behind it is that of all.
MatrixXd LiveFactor::EnvelopeProduct(const SparseColumns& V) const {
  const EnvelopeCholesky& L = resumed_->cholesky();
  const RowOrder& order = resumed_->order();
  int first = L.num_rows();
  for (const int row : V.rows) {
    first = std::min(first, order.place(row));
  }
  // From quad to quad: rows of L begin on one, which may be before the first.
  // Zeros outside the rows of V, which all columns overwrite: b need not be cleared between them.
  AlignedVector<double> b(L.offsets().back(), 0.0);
  AlignedVector<double> y(L.offsets().back() + kQuad, 0.0);
  const int begin = L.offsets()[first], size = L.offsets().back() - begin;
  MatrixXd solved(size, V.values.cols());
  for (Eigen::Index column = 0; column < V.values.cols(); ++column) {
    for (std::size_t k = 0; k < V.rows.size(); ++k) {
      const int place = order.place(V.rows[k]);
      std::copy_n(V.values.col(column).data() + V.begin[k],
                  L.offsets()[place + 1] - L.offsets()[place], b.begin() + L.offsets()[place]);
    }
    L.ForwardSubstitute(b.data(), first, y.data());
    solved.col(column) = Eigen::Map<const Eigen::VectorXd>(y.data() + begin, size);
  }
  return solved.transpose() * solved;
}

Status LiveFactor::Solve(const std::vector<int>& offsets, const double* b, double* x) const {
  if (tree_ != nullptr) {
    SolveByTree(offsets, b, x);
  } else if (resumed_ != nullptr) {
    SolveByEnvelope(offsets, b, x);
  } else {
    return other_->Solve(b, {}, {}, x);
  }
  return Status::Ok();
}

// Forward through all cliques, children first, then backward, parents first. x is packed by rows of
// S and serves as the place where a clique finds what its separator got.
void LiveFactor::SolveByTree(const std::vector<int>& offsets, const double* b, double* x) const {
  const CliqueTree& tree = tree_->tree();
  // A b with entries everywhere reaches all cliques.
  ForwardPaths y(tree);
  for (int i = 0; i < y.size(); ++i) {
    const Clique& clique = y.clique(i);
    double* y_i = y.Of(i);
    for (int k = 0; k < clique.num_pivots; ++k) {
      const double* b_row = b + offsets[clique.rows[k]];
      // Added to what the children have left there.
      std::transform(b_row, b_row + tree.SizeOf(clique.rows[k]), y_i + clique.places[k],
                     y_i + clique.places[k], [](double a, double sum) { return a + sum; });
    }
    y.SolveForward(i);
  }
  for (int i = y.size() - 1; i >= 0; --i) {
    const Clique& clique = y.clique(i);
    double* y_i = y.Of(i);
    // x of the separator, which cliques further up have found by now.
    for (std::size_t k = clique.num_pivots; k < clique.rows.size(); ++k) {
      std::copy_n(x + offsets[clique.rows[k]], tree.SizeOf(clique.rows[k]), y_i + clique.places[k]);
    }
    // The padding is multiplied by that of L: no garbage may be in it.
    std::fill(y_i + clique.front.below() + clique.front.height, y_i + clique.front.num_rows(), 0.0);
    SolveFrontBackward(clique.front, clique.L.data(), y_i);
    for (int k = 0; k < clique.num_pivots; ++k) {
      std::copy_n(y_i + clique.places[k], tree.SizeOf(clique.rows[k]), x + offsets[clique.rows[k]]);
    }
  }
}

// The envelope has its rows by places: b goes there, x comes back.
void LiveFactor::SolveByEnvelope(const std::vector<int>& offsets, const double* b,
                                 double* x) const {
  const EnvelopeCholesky& L = resumed_->cholesky();
  const RowOrder& order = resumed_->order();
  AlignedVector<double> right(L.offsets().back(), 0.0);
  AlignedVector<double> left(L.offsets().back() + kQuad, 0.0);
  for (int place = 0; place < L.num_rows(); ++place) {
    std::copy_n(b + offsets[order.row(place)], L.offsets()[place + 1] - L.offsets()[place],
                right.begin() + L.offsets()[place]);
  }
  L.Solve(right.data(), left.data());
  for (int place = 0; place < L.num_rows(); ++place) {
    std::copy_n(left.begin() + L.offsets()[place], L.offsets()[place + 1] - L.offsets()[place],
                x + offsets[order.row(place)]);
  }
}

}  // namespace inceres::internal
