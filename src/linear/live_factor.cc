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

// The vectors of some cliques' fronts, `columns` of each, one after the other.
class FrontVectors {
 public:
  FrontVectors(const CliqueTree& tree, std::vector<int> cliques, int columns)
      : tree_(tree), cliques_(std::move(cliques)), place_(tree.cliques().size(), -1) {
    // Stamps rise from children to parents: a forward pass in this order finds all that is below it
    // done.
    std::sort(cliques_.begin(), cliques_.end(),
              [&](int a, int b) { return tree.clique(a).stamp < tree.clique(b).stamp; });
    std::size_t size = 0;
    for (const int c : cliques_) {
      place_[c] = static_cast<std::ptrdiff_t>(size);
      size += static_cast<std::size_t>(columns) * tree.clique(c).front.num_rows();
    }
    values_.assign(size, 0.0);
  }

  const std::vector<int>& cliques() const { return cliques_; }  // children before parents
  bool Has(int c) const { return place_[c] >= 0; }
  double* Of(int c, int column) {
    return values_.data() + place_[c] + std::ptrdiff_t{column} * tree_.clique(c).front.num_rows();
  }
  // y of this clique, and what it leaves to its parent.
  void SolveForward(int c, int column) {
    const Clique& clique = tree_.clique(c);
    double* y = Of(c, column);
    SolveFrontForward(clique.front, clique.L.data(), y);
    if (clique.front.parent == CliqueTree::kNone) {
      return;
    }
    // y₂ after the pivots were taken out is what the parent gets, by the runs that its update
    // matrix has.
    const double* update = y + clique.front.below();
    double* above = Of(clique.front.parent, column);
    for (const FrontRun& run : clique.runs) {
      for (int k = 0; k < run.length; ++k) {
        above[run.to + k] += update[run.from + k];
      }
    }
  }

 private:
  const CliqueTree& tree_;
  std::vector<int> cliques_;
  std::vector<std::ptrdiff_t> place_;
  AlignedVector<double> values_;
};

// The cliques of these rows, and what is above.
std::vector<int> PathsToRoot(const CliqueTree& tree, const std::vector<int>& rows) {
  std::vector<int> cliques;
  std::vector<char> listed(tree.cliques().size(), 0);
  for (const int row : rows) {
    for (int c = tree.CliqueOf(row); c != CliqueTree::kNone && listed[c] == 0;
         c = tree.clique(c).front.parent) {
      // The path ends where another one has been: above it everything is listed.
      listed[c] = 1;
      cliques.push_back(c);
    }
  }
  return cliques;
}

std::vector<int> AllCliques(const CliqueTree& tree) {
  std::vector<int> cliques;
  for (std::size_t c = 0; c < tree.cliques().size(); ++c) {
    if (tree.cliques()[c].is_used) {
      cliques.push_back(static_cast<int>(c));
    }
  }
  return cliques;
}

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
    *product = TreeProduct(V);
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

MatrixXd LiveFactor::TreeProduct(const SparseColumns& V) const {
  const CliqueTree& tree = tree_->tree();
  const int columns = static_cast<int>(V.values.cols());
  // Zeros but in the rows of V, each of which is a pivot of the clique it begins in.
  FrontVectors y(tree, PathsToRoot(tree, V.rows), columns);
  for (std::size_t k = 0; k < V.rows.size(); ++k) {
    const int row = V.rows[k];
    for (int column = 0; column < columns; ++column) {
      std::copy_n(V.values.col(column).data() + V.begin[k], tree.SizeOf(row),
                  y.Of(tree.CliqueOf(row), column) + tree.PlaceOf(row));
    }
  }
  MatrixXd product = MatrixXd::Zero(columns, columns);
  for (const int c : y.cliques()) {
    for (int column = 0; column < columns; ++column) {
      y.SolveForward(c, column);
    }
    const Front& front = tree.clique(c).front;
    const Eigen::Map<const MatrixXd, 0, Eigen::OuterStride<>> pivots(
        y.Of(c, 0), front.width, columns, Eigen::OuterStride<>(front.num_rows()));
    // The share of this clique: its pivots' rows of L⁻¹V. Those beyond belong to cliques further
    // up.
    product.noalias() += pivots.transpose().lazyProduct(pivots);
  }
  return product;
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
  FrontVectors y(tree, AllCliques(tree), 1);
  for (const int c : y.cliques()) {
    const Clique& clique = tree.clique(c);
    for (int k = 0; k < clique.num_pivots; ++k) {
      const double* b_row = b + offsets[clique.rows[k]];
      // Added to what the children have left there.
      std::transform(b_row, b_row + tree.SizeOf(clique.rows[k]), y.Of(c, 0) + clique.places[k],
                     y.Of(c, 0) + clique.places[k], [](double a, double sum) { return a + sum; });
    }
    y.SolveForward(c, 0);
  }
  for (auto c = y.cliques().rbegin(); c != y.cliques().rend(); ++c) {
    const Clique& clique = tree.clique(*c);
    double* y_c = y.Of(*c, 0);
    // x of the separator, which cliques further up have found by now.
    for (std::size_t k = clique.num_pivots; k < clique.rows.size(); ++k) {
      std::copy_n(x + offsets[clique.rows[k]], tree.SizeOf(clique.rows[k]), y_c + clique.places[k]);
    }
    // The padding is multiplied by that of L: no garbage may be in it.
    std::fill(y_c + clique.front.below() + clique.front.height, y_c + clique.front.num_rows(), 0.0);
    SolveFrontBackward(clique.front, clique.L.data(), y_c);
    for (int k = 0; k < clique.num_pivots; ++k) {
      std::copy_n(y_c + clique.places[k], tree.SizeOf(clique.rows[k]), x + offsets[clique.rows[k]]);
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
