#include "linear/front_qr.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/QR>

#include "linear/rows_by_size.h"

namespace inceres::internal {

// Sparse QR of the rows of a Jacobian, front by front, for covariances that may not square the
// condition number (docs/algorithms.md, "Covariance"; Liu 1986; Davis 2011). Each front stacks its
// own rows and the triangles of its children and reduces them,
//
//     Qᵀ [rows of the front; triangles of children] = [R₁ R₂; 0 T],
//
// where R₁ and R₂ are the rows of R for its pivots, so that [R₁ R₂]ᵀ are the front's columns of L,
// and T is what it leaves to its parent. Q is not kept.
//
// Rows come in order of size, which reflections need to be accurate row by row where weights are
// very different, as those of a tight prior are. A bound row by row takes columns in order of
// their norms as well (Cox & Higham 1998); here they stay in the order of elimination, as L has
// it, and a stiff row that hardly has the first column of a front costs weak ones digits. The signs
// of the rows of R are free; with no negative diagonal Rᵀ is the Cholesky factor.
//
// Rows and triangles are given up as they are used; what waits are the triangles of fronts whose
// parent is still to come.

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Rows that a reduction is worth: so many, and as a multiple of the columns, for the triangle of
// before goes through it again.
constexpr Index kWorthReducing = 128;
constexpr Index kTimesColumns = 3;

// Reduces the rows of the stack to a triangle. The stack keeps its memory, for rows to come.
void Reduce(MatrixXd* stack, Index* num_rows) {
  if (*num_rows == 0) {
    return;
  }
  MatrixXd sorted = SortedRows(*stack, stack->topRows(*num_rows));
  // In place of the sorted rows; Eigen keeps the reflections below the diagonal, which the
  // triangular view leaves out.
  const Eigen::HouseholderQR<Eigen::Ref<MatrixXd>> qr(sorted);
  *num_rows = std::min(*num_rows, stack->cols());
  stack->topRows(*num_rows) =
      sorted.topRows(*num_rows).triangularView<Eigen::Upper>().toDenseMatrix();
}

// Room for so many rows more. A front of few columns and very many rows is reduced now and then,
// which bounds its memory: the triangle takes the place of the rows, with the same RᵀR.
void MakeRoom(Index more, MatrixXd* stack, Index* num_rows) {
  const Index enough = kTimesColumns * stack->cols() + kWorthReducing;
  if (*num_rows >= enough) {
    Reduce(stack, num_rows);
  }
  if (*num_rows + more > stack->rows()) {
    stack->conservativeResize(std::max(*num_rows + more, enough), Eigen::NoChange);
  }
  // Rows have entries in a part of the columns only.
  stack->middleRows(*num_rows, more).setZero();
}

}  // namespace

FrontQr::FrontQr(const FrontTree& tree, const BlockPattern& pattern, double least)
    : tree_(tree),
      least_(least),
      rows_(tree, pattern),
      added_(tree.fronts.size()),
      left_(tree.fronts.size()) {
}

// All of the rows' blocks are among the rows of the front that eliminates the first of them, since
// they are neighbors in the pattern.
void FrontQr::Add(RowsOfBlocks rows) {
  if (rows.values.size() == 0) {
    return;
  }
  const auto first = std::min_element(rows.blocks.begin(), rows.blocks.end(), [this](int a, int b) {
    return rows_.position(a) < rows_.position(b);
  });
  added_[static_cast<std::size_t>(rows_.front_of(*first))].push_back(std::move(rows));
}

// The columns of a child's triangle are its rows beyond the pivots; the runs say where the parent
// has them.
void FrontQr::StackChild(int child, MatrixXd* stack, Index* num_rows) const {
  const Front& from = tree_.fronts[child];
  const Front& front = tree_.fronts[from.parent];
  const MatrixXd& left = left_[static_cast<std::size_t>(child)];
  MakeRoom(left.rows(), stack, num_rows);
  for (int run = from.run_begin; run < from.run_end; ++run) {
    const auto [first, to, length] = tree_.runs[run];
    // A run counts rows as they are in memory, with the pivots padded to quads; the stack has no
    // padding.
    const int column = to < front.width ? to : to - front.below() + front.width;
    stack->block(*num_rows, column, left.rows(), length) = left.middleCols(first, length);
  }
  *num_rows += left.rows();
}

// Each block where the front has its scalars; positions, not indices of the pattern, tell which.
void FrontQr::StackRows(const RowsOfBlocks& rows, int f, MatrixXd* stack, Index* num_rows) const {
  MakeRoom(rows.values.rows(), stack, num_rows);
  Index from = 0;
  for (const int block : rows.blocks) {
    stack->block(*num_rows, rows_.RowIn(f, rows_.position(block)), rows.values.rows(),
                 rows_.size(block)) = rows.values.middleCols(from, rows_.size(block));
    from += rows_.size(block);
  }
  *num_rows += rows.values.rows();
}

// Children's triangles first, then own rows, in the order in which they were added.
int FrontQr::Eliminate(int f, double* L) {
  const Front& front = tree_.fronts[f];
  const int columns = front.width + front.height;
  MatrixXd stack(0, columns);
  Index num_rows = 0;
  for (int k = front.child_begin; k < front.child_end; ++k) {
    StackChild(tree_.children[k], &stack, &num_rows);
    // A triangle has one reader.
    left_[static_cast<std::size_t>(tree_.children[k])] = MatrixXd();
  }
  for (const RowsOfBlocks& rows : std::exchange(added_[static_cast<std::size_t>(f)], {})) {
    StackRows(rows, f, &stack, &num_rows);
  }
  Reduce(&stack, &num_rows);
  std::fill_n(L, static_cast<std::ptrdiff_t>(front.stride()) * front.width, 0.0);
  for (int j = 0; j < front.width; ++j, L += front.stride()) {
    // Fewer rows than pivots leave a trapezoid: no row determines the rest of the pivots.
    const double diagonal = j < num_rows ? stack(j, j) : 0.0;
    // The comparison fails for NaN.
    if (!(std::fabs(diagonal) > least_) || !std::isfinite(diagonal)) {
      return j;
    }
    const double sign = diagonal < 0.0 ? -1.0 : 1.0;
    // Row j of R is column j of L, with the padding of the front between the pivots and the others.
    for (int k = j; k < columns; ++k) {
      L[k < front.width ? k : front.below() + k - front.width] = sign * stack(j, k);
    }
  }
  // No rows where the pivots took them all.
  left_[static_cast<std::size_t>(f)] = stack.block(
      front.width, front.width, std::max<Index>(0, num_rows - front.width), front.height);
  return -1;
}

}  // namespace inceres::internal
