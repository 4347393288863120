#include "marginal/orthogonal_elimination.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <Eigen/Dense>

#include "base/sort_unique.h"
#include "linear/rows_by_size.h"
#include "linearize/jacobian_map.h"

namespace inceres::internal {

// Elimination of landmarks without normal equations (docs/algorithms.md, "Covariance"):
//     Qᵀ [J_l J_c] = [R T; 0 J*]
//
// One dense QR factorization of a landmark's few columns over all of its rows, by Householder
// reflections. Rows are sorted by size, and the column comes next that has most left, so that rows
// of a weak factor keep their digits beside those of a stiff one (Cox & Higham 1998). It takes
// both: a stiff row that hardly has a column would be mixed into weak ones by that column's
// reflection. Q is applied to the frames' columns and forgotten.
//
// Nothing is kept between calls but which factors touch which landmark: Eliminate computes anew
// each time, on any thread.

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

}  // namespace

// A triangle of at most four rows. Only of an R that Inflation has found regular. R = R' Πᵀ with
// the triangle R', so its inverse is Π R'⁻¹.
MatrixXd OrthogonalElimination::Landmark::InverseOfR() const {
  const MatrixXd inverse = triangle.triangularView<Eigen::Upper>().solve(
      MatrixXd::Identity(triangle.rows(), triangle.cols()));
  MatrixXd rows(inverse.rows(), inverse.cols());
  for (Index k = 0; k < columns.size(); ++k) {
    rows.row(columns[k]) = inverse.row(k);
  }
  return rows;
}

double OrthogonalElimination::Landmark::Inflation() const {
  // A zero or a NaN on the diagonal, or anything that is not finite.
  if (!(triangle.diagonal().cwiseAbs().minCoeff() > 0.0) || !triangle.allFinite()) {
    return HUGE_VAL;
  }
  // (P⁻¹)_ii = ‖row i of R⁻¹‖², over 1 / P_ii, P_ii = ‖column i of J_l‖².
  const double inflation =
      (InverseOfR().rowwise().squaredNorm().array() * squares.array()).maxCoeff();
  return std::isfinite(inflation) ? inflation : HUGE_VAL;
}

OrthogonalElimination::OrthogonalElimination(const FactorGraph& graph, const Layout& layout,
                                             const Evaluator& evaluator)
    : graph_(graph),
      layout_(layout),
      evaluator_(evaluator),
      factors_of_(static_cast<std::size_t>(layout.num_landmarks())) {
  for (std::size_t f = 0; f < evaluator.families().size(); ++f) {
    const Linearization& family = evaluator.families()[f];
    for (int i = 0; i < family.num_factors; ++i) {
      const int landmark = layout.LandmarkAmong(graph.Variables(family.id, i), family.num_slots);
      std::vector<Ref>& list =
          landmark < 0 ? others_ : factors_of_[static_cast<std::size_t>(landmark)];
      list.push_back({static_cast<int>(f), i});
    }
  }
}

// Rows of zeros for these factors, with the frames they touch.
RowsOfBlocks OrthogonalElimination::Frames(const std::vector<Ref>& factors) const {
  RowsOfBlocks rows;
  Index count = 0;
  for (const Ref& ref : factors) {
    const Linearization& family = evaluator_.families()[static_cast<std::size_t>(ref.family)];
    // All residuals of all of these factors are rows.
    count += family.residual_size;
    const VariableId* ids = graph_.Variables(family.id, ref.factor);
    for (int s = 0; s < family.num_slots; ++s) {
      if (layout_.FrameOf(ids[s]) >= 0) {
        rows.blocks.push_back(layout_.FrameOf(ids[s]));
      }
    }
  }
  // Ascending, each once: columns of T and J* are in this order.
  SortUnique(&rows.blocks);
  const Index columns =
      std::accumulate(rows.blocks.begin(), rows.blocks.end(), Index{0},
                      [this](Index sum, int frame) { return sum + layout_.TangentSize(frame); });
  rows.values = MatrixXd::Zero(count, columns);
  return rows;
}

// The Jacobians, of the landmark's into J_l.
// Jacobians as the linearization has them: in the tangent space, corrected for the loss.
void OrthogonalElimination::Fill(const std::vector<Ref>& factors, int landmark, RowsOfBlocks* rows,
                                 MatrixXd* J_l) const {
  std::vector<Index> column = {0};
  for (const int frame : rows->blocks) {
    column.push_back(column.back() + layout_.TangentSize(frame));
  }
  Index row = 0;
  for (const Ref& ref : factors) {
    const Linearization& family = evaluator_.families()[static_cast<std::size_t>(ref.family)];
    const VariableId* ids = graph_.Variables(family.id, ref.factor);
    for (int s = 0; s < family.num_slots; ++s) {
      const int frame = layout_.FrameOf(ids[s]);
      const bool of_landmark = landmark >= 0 && layout_.LandmarkOf(ids[s]) == landmark;
      // A constant has no columns.
      if (frame < 0 && !of_landmark) {
        continue;
      }
      const JacobianMap J = JacobianOf(family.slots[s], ref.factor, family.residual_size);
      if (of_landmark) {
        J_l->middleRows(row, family.residual_size) += J;
      } else {
        // rows->blocks ascends.
        const auto at = std::lower_bound(rows->blocks.begin(), rows->blocks.end(), frame);
        rows->values.block(row, column[static_cast<std::size_t>(at - rows->blocks.begin())],
                           J.rows(), J.cols()) += J;
      }
    }
    row += family.residual_size;
  }
}

// Cost: some 4 m d n flops, of m rows, d columns of the landmark and n of its frames.
OrthogonalElimination::Landmark OrthogonalElimination::Eliminate(int landmark) const {
  const std::vector<Ref>& factors = factors_of_[static_cast<std::size_t>(landmark)];
  const Index size = layout_.TangentSize(layout_.num_frames + landmark);
  Landmark result;
  result.rest = Frames(factors);
  const Index num_rows = result.rest.values.rows();
  MatrixXd J_l = MatrixXd::Zero(num_rows, size);
  Fill(factors, landmark, &result.rest, &J_l);
  // Before Q, which would leave them as they are only up to rounding.
  result.squares = J_l.colwise().squaredNorm();
  // Rows of zeros where there are fewer residuals than degrees of freedom: R has its size, and a
  // zero on its diagonal tells.
  MatrixXd A(std::max(num_rows, size), size + result.rest.values.cols());
  A.setZero();
  A.topLeftCorner(num_rows, size) = J_l;
  A.topRightCorner(num_rows, result.rest.values.cols()) = result.rest.values;
  // By the largest entry over all columns, for Q mixes whole rows: a row keeps its digits beside a
  // much larger one.
  A = SortedRows(A, A);
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(A.leftCols(size));
  MatrixXd turned = A.rightCols(result.rest.values.cols());
  turned.applyOnTheLeft(qr.householderQ().adjoint());
  result.triangle = qr.matrixQR().topRows(size).triangularView<Eigen::Upper>().toDenseMatrix();
  result.columns = qr.colsPermutation().indices();
  result.T = turned.topRows(size);
  // What the landmark's rows say of the frames once it is gone.
  result.rest.values = turned.bottomRows(A.rows() - size);
  return result;
}

// They are rows of a root of S as they stand: there is nothing to eliminate.
std::vector<RowsOfBlocks> OrthogonalElimination::OtherRows() const {
  std::vector<RowsOfBlocks> all;
  for (const Ref& ref : others_) {
    RowsOfBlocks rows = Frames({ref});
    MatrixXd none;
    Fill({ref}, -1, &rows, &none);
    all.push_back(std::move(rows));
  }
  return all;
}

}  // namespace inceres::internal
