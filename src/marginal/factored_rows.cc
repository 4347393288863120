// FactoredNormals by orthogonal transformations of the Jacobian: CovarianceAlgorithm::kQr.

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Dense>

#include "linear/front_qr.h"
#include "linear/not_positive_definite.h"
#include "marginal/factored_normals.h"

namespace inceres::internal {

// From S on everything goes as by normal equations, since both have a triangle L with L Lᵀ = S:
// here L = Rᵀ, of the QR factors of a root of S that was never multiplied out (docs/algorithms.md,
// "Covariance"). Rows of landmarks go through two reductions: first J_l is eliminated from a
// landmark's own rows, then what is left, with rows of other factors, is gathered in the fronts of
// the same tree that a Cholesky factorization would have used.
//
// What is lost: S itself. So directions that are open are not looked for, and diag(S) is summed
// from the rows. Variances are held against that, and not against diag(C), as those of normal
// equations are: weak rows keep their digits here beside stiff ones that landmarks take up, and a
// frame that is held weakly may be seen through the stiffest of measurements. A root of S_kk is
// exact to ε √E_kk, with E as in factored_normals.cc.

// Diagonal of S, from the rows of a root of it.
void FactoredNormals::AddSquares(const RowsOfBlocks& rows) {
  Eigen::Index column = 0;
  // Before the rows are moved into a front. Sums of squares: an entry of this diagonal has no
  // cancellation, where C − Y Yᵀ may.
  for (const int frame : rows.blocks) {
    for (int k = 0; k < layout_.TangentSize(frame); ++k, ++column) {
      diagonal_[layout_.packed_offset[frame] + k] += rows.values.col(column).squaredNorm();
    }
  }
}

// The rows that all landmarks and the other factors leave for the frames, and by how much each
// landmark inflates what it rounds them by. A landmark that its own rows do not determine is an
// error.
Status FactoredNormals::EliminateByRows(double least, std::vector<RowsOfBlocks>* rows,
                                        std::vector<double>* inflations) {
  // From now on FindDirections finds nothing, and columns are made by rows.
  by_rows_ = std::make_unique<OrthogonalElimination>(graph_, layout_, evaluator_);
  const auto num_landmarks = static_cast<std::size_t>(layout_.num_landmarks());
  rows->resize(num_landmarks);
  inflations->resize(num_landmarks);
  // One byte a landmark: each task writes its own, and the first open one in the problem's order is
  // named, whichever task met it.
  std::vector<char> open(num_landmarks, 0);
  executor_.For(layout_.num_landmarks(), 16, [&](int begin, int end) {
    for (int l = begin; l < end; ++l) {
      OrthogonalElimination::Landmark landmark = by_rows_->Eliminate(l);
      // By two rules: ours, which does not depend on units, and SuiteSparseQR's, if `least` is set.
      // Negated, so that NaN is open.
      const double inflation = landmark.Inflation();
      const bool is_open = !(inflation <= options_.max_inflation) ||
                           !(landmark.triangle.diagonal().cwiseAbs().minCoeff() > least);
      open[static_cast<std::size_t>(l)] = is_open ? 1 : 0;
      // One that uses up all of its rows leaves nothing, and no rounding.
      (*inflations)[static_cast<std::size_t>(l)] =
          landmark.rest.values.rows() > 0 ? inflation : 0.0;
      // R and T are dropped: few of many landmarks are asked for, and those are eliminated once
      // more.
      (*rows)[static_cast<std::size_t>(l)] = std::move(landmark.rest);
    }
  });
  std::vector<int> open_ones;
  for (int l = 0; l < layout_.num_landmarks(); ++l) {
    if (open[static_cast<std::size_t>(l)] != 0) {
      open_ones.push_back(l);
    }
  }
  const Status status = NameOpen(open_ones);
  if (!status.ok()) {
    return status;
  }
  // Behind the landmarks' rows: the order of rows has its part in the bits of the result.
  for (RowsOfBlocks& others : by_rows_->OtherRows()) {
    rows->push_back(std::move(others));
  }
  return Status::Ok();
}

// Squared norms of the columns of J, the diagonal of H: frames first, whose are that of C.
// `weights`: of the squares in rows of each landmark; empty: 1.
Eigen::VectorXd FactoredNormals::ColumnSquares(const std::vector<double>& weights) const {
  Eigen::VectorXd squares = Eigen::VectorXd::Zero(layout_.size());
  for (const Linearization& cache : evaluator_.families()) {
    for (int i = 0; i < cache.num_factors; ++i) {
      const VariableId* ids = graph_.Variables(cache.id, i);
      const int landmark = weights.empty() ? -1 : layout_.LandmarkAmong(ids, cache.num_slots);
      const double weight = landmark < 0 ? 1.0 : weights[static_cast<std::size_t>(landmark)];
      for (int s = 0; s < cache.num_slots; ++s) {
        const SlotJacobians& slot = cache.slots[s];
        const double* J = slot.data + i * slot.factor_stride;
        const int position = layout_.Position(ids[s]);
        for (int r = 0; position >= 0 && r < cache.residual_size; ++r, J += slot.row_stride) {
          for (int c = 0; c < slot.columns; ++c) {
            squares[layout_.packed_offset[position] + c] += weight * J[c] * J[c];
          }
        }
      }
    }
  }
  return squares;
}

// Landmarks, fronts, gauge. L is in factor_ afterwards, as after a Cholesky factorization, so that
// solves and the selected inverse do not know the difference.
Status FactoredNormals::FactorizeRows() {
  const Eigen::VectorXd squares = ColumnSquares({});
  const double largest = squares.size() > 0 ? std::sqrt(squares.maxCoeff()) : 0.0;
  const double least = options_.min_column_remainder * largest;
  std::vector<RowsOfBlocks> rows;
  std::vector<double> inflations;
  Status status = EliminateByRows(least, &rows, &inflations);
  if (!status.ok() || layout_.num_frames == 0) {
    return status;
  }
  rounding_ = ColumnSquares(inflations).head(layout_.frame_size());
  diagonal_.setZero(pattern().size());
  // By the pattern alone: S has no values here.
  status = factor_.Analyze(ReducedMatrix(pattern(), nullptr, nullptr));
  if (!status.ok()) {
    return status;
  }
  FrontQr qr(factor_.tree(), pattern(), least);
  for (RowsOfBlocks& each : rows) {
    AddSquares(each);
    qr.Add(std::move(each));
  }
  // Front by front, children first, each written in place of what a Cholesky factorization would
  // have written.
  status = NameVariable(factor_,
                        factor_.FactorizeBy([&qr](int f, double* L) { return qr.Eliminate(f, L); }),
                        [this](std::size_t frame) { return layout_.variables[frame]; });
  return status.ok() ? CheckGauge()
                     : Status::Error(status.code,
                                     "there is no covariance: the gauge is free, or a variable is "
                                     "not determined (" +
                                         status.message + ")");
}

}  // namespace inceres::internal
