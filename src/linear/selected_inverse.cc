#include "linear/selected_inverse.h"

#include <algorithm>

#include <Eigen/Dense>

#include "simd/kernels.h"

namespace inceres::internal {

// Entries of A⁻¹ from L alone, front by front, parents first (docs/algorithms.md, "Covariance";
// Takahashi, Fagan & Chen 1973; Erisman & Tinney 1975). From A⁻¹ L = L⁻ᵀ, by blocks of a front,
//
//     Σ₂₁ = −Σ₂₂ M,    Σ₁₁ = (L₁ L₁ᵀ)⁻¹ − Mᵀ Σ₂₁,    M = L₂ L₁⁻¹,
//
// and Σ₂₂ has no entries that the parent lacks, because the rows of a front beyond its pivots are
// rows of its parent.
//
// What is kept of a front is [Σ₁₁ Σ₂₁ᵀ], pivots by rows, in one array for all fronts. Σ₂₂ is in the
// parent's array or in the parent's own Σ₂₂; it is gathered into an array of its own, in both
// triangles, so that the product with it is one kernel call, and lives until the last child has
// asked. Σ₁₁ is stored whole; its halves agree up to rounding, and children read one of them.

namespace {

using Strided = Eigen::Map<Eigen::MatrixXd, 0, Eigen::OuterStride<>>;
using ConstStrided = Eigen::Map<const Eigen::MatrixXd, 0, Eigen::OuterStride<>>;

// Columns a task: a multiple of what the kernels take at a time, so that tasks do not change the
// arithmetic.
constexpr int kStrip = 48;
// Rows of a triangle's inverse at a time, whole quads.
constexpr int kTriangleStrip = 24;
// Below this a front's strips are one task.
constexpr double kParallelFlops = 2e6;

}  // namespace

// All memory for the result is taken at once and is zero: the products are subtracted into it, and
// padding stays zero.
SelectedInverse::SelectedInverse(const SparseCholesky& factor, const BlockPattern& pattern,
                                 const Executor& executor)
    : tree_(factor.tree()), rows_(factor.tree(), pattern) {
  const int num_fronts = static_cast<int>(tree_.fronts.size());
  begin_.assign(static_cast<std::size_t>(num_fronts) + 1, 0);
  for (int f = 0; f < num_fronts; ++f) {
    const Front& front = tree_.fronts[f];
    begin_[f + 1] = begin_[f] + static_cast<std::size_t>(front.below()) *
                                    static_cast<std::size_t>(front.width + front.height);
  }
  values_ = ZeroedArray(begin_.back());
  waiting_.resize(static_cast<std::size_t>(num_fronts));
  // Every subtree is a range of fronts and parents come behind it, so descending order meets
  // parents first.
  for (int f = num_fronts - 1; f >= 0; --f) {
    Invert(factor, f, executor);
  }
}

// Per front: the inverse of the triangle and its square, T, and the two products.
double SelectedInverse::PredictedFlops(const FrontTree& tree) {
  double flops = 0.0;
  for (const Front& front : tree.fronts) {
    const double w = front.width, h = front.height;
    flops += w * (w * (w + 2.0 * h) + 2.0 * h * h) + h * h;
  }
  return flops;
}

void SelectedInverse::Invert(const SparseCholesky& factor, int f, const Executor& executor) {
  GatherRest(f);
  InvertPivots(factor, f);
  Eliminate(f, executor);
  const Front& front = tree_.fronts[f];
  // Nobody asks a leaf for its Σ₂₂.
  if (front.child_begin == front.child_end) {
    waiting_[f] = Waiting();
  }
  // Fronts come parents first, so the first child is the last to ask.
  if (front.parent >= 0 && tree_.children[tree_.fronts[front.parent].child_begin] == f) {
    waiting_[front.parent] = Waiting();
  }
}

// Entry of A⁻¹ at two rows of the front, row ≥ column.
// Where both are beyond the pivots it is in Σ₂₂; otherwise the earlier one is a pivot, and the
// entry is in its row of [Σ₁₁ Σ₂₁ᵀ].
double SelectedInverse::FromParent(int parent, int row, int column) const {
  const Front& front = tree_.fronts[parent];
  if (column >= front.below()) {
    const Waiting& rest = waiting_[parent];
    return rest.values[static_cast<std::size_t>(column - front.below()) * rest.stride + row -
                       front.below()];
  }
  // Columns of [Σ₁₁ Σ₂₁ᵀ] are the front's rows without the padding behind the pivots.
  const int at = row < front.below() ? row : front.width + row - front.below();
  return Transposed(parent)[static_cast<std::ptrdiff_t>(at) * front.below() + column];
}

// Run by run on both sides. Runs ascend in the parent as well, so that row ≥ column holds there,
// too. A root has no runs and no Σ₂₂.
void SelectedInverse::GatherRest(int f) {
  const Front& front = tree_.fronts[f];
  Waiting& rest = waiting_[f];
  rest.stride = front.update_stride();
  rest.values.assign(static_cast<std::size_t>(rest.stride) * front.height, 0.0);
  for (int i = front.run_begin; i < front.run_end; ++i) {
    const FrontRun& columns = tree_.runs[i];
    for (int c = 0; c < columns.length; ++c) {
      const int column = columns.from + c;
      for (int j = i; j < front.run_end; ++j) {
        const FrontRun& rows = tree_.runs[j];
        for (int r = j == i ? c : 0; r < rows.length; ++r) {
          const double value = FromParent(front.parent, rows.to + r, columns.to + c);
          const int row = rows.from + r;
          rest.values[static_cast<std::size_t>(column) * rest.stride + row] = value;
          rest.values[static_cast<std::size_t>(row) * rest.stride + column] = value;
        }
      }
    }
  }
}

// Σ₁₁ = (L₁ L₁ᵀ)⁻¹ for now, and T = Mᵀ = L₁⁻ᵀ L₂ᵀ, which overwrites a copy of L₂ᵀ.
void SelectedInverse::InvertPivots(const SparseCholesky& factor, int f) {
  const Front& front = tree_.fronts[f];
  InvertTriangle(front, factor.Column(f, 0));
  SquareInverse(front, Transposed(f));
  const ConstStrided L(factor.Column(f, 0), front.num_rows(), front.width,
                       Eigen::OuterStride<>(front.stride()));
  T_.assign(static_cast<std::size_t>(front.below()) * front.height, 0.0);
  Strided T(T_.data(), front.width, front.height, Eigen::OuterStride<>(front.below()));
  T = L.middleRows(front.below(), front.height).transpose();
  L.topRows(front.width).triangularView<Eigen::Lower>().transpose().solveInPlace(T);
}

// X = L₁⁻ᵀ by strips of rows, each from its own pivots on: ahead of them it is zero.
void SelectedInverse::InvertTriangle(const Front& front, const double* L) {
  const int below = front.below();
  X_.assign(static_cast<std::size_t>(below) * front.width, 0.0);
  for (int first = 0; first < front.width; first += kTriangleStrip) {
    double* const X = X_.data() + static_cast<std::ptrdiff_t>(first) * below + first;
    const int count = std::min(kTriangleStrip, front.width - first);
    for (int k = 0; k < count; ++k) {
      X[static_cast<std::ptrdiff_t>(k) * below + k] = 1.0;
    }
    BestKernels().solve_lower_transposed(
        std::min(kTriangleStrip, below - first), front.width - first,
        L + static_cast<std::ptrdiff_t>(first) * front.stride() + first, front.stride(), X, below);
  }
}

// X Xᵀ: the kernel subtracts, so its negative first, from the top down to the diagonal, and then
// both halves.
void SelectedInverse::SquareInverse(const Front& front, double* square) const {
  const std::ptrdiff_t below = front.below();
  for (int first = 0; first < front.width; first += kTriangleStrip) {
    const double* const X = X_.data() + first * below;
    BestKernels().subtract_outer(std::min(first + kTriangleStrip, front.below()),
                                 std::min(kTriangleStrip, front.width - first), front.width - first,
                                 X, front.below(), X + first, front.below(), square + first * below,
                                 front.below());
  }
  for (int c = 0; c < front.width; ++c) {
    for (int r = 0; r <= c; ++r) {
      square[c * below + r] = -square[c * below + r];
      square[r * below + c] = square[c * below + r];
    }
  }
}

// Σ₂₁ᵀ = −T Σ₂₂, Σ₁₁ −= T Σ₂₁.
// The columns of Σ₂₁ᵀ are cut into strips and are independent; Σ₁₁ takes all of them and follows on
// one thread.
void SelectedInverse::Eliminate(int f, const Executor& executor) {
  const Front& front = tree_.fronts[f];
  const Waiting& rest = waiting_[f];
  const int below = front.below();
  double* others = Transposed(f) + static_cast<std::ptrdiff_t>(front.width) * below;
  const int count = (front.height + kStrip - 1) / kStrip;
  executor.For(count, front.flops() > kParallelFlops ? 1 : count, [&](int first, int end) {
    for (int k = first; k < end; ++k) {
      const int column = k * kStrip;
      // The kernel takes rows of its second operand; those of Σ₂₂ are its columns.
      BestKernels().subtract_outer(below, std::min(kStrip, front.height - column), front.height,
                                   T_.data(), below, rest.values.data() + column, rest.stride,
                                   others + static_cast<std::ptrdiff_t>(column) * below, below);
    }
  });
  BestKernels().subtract_outer(below, front.width, front.height, T_.data(), below, others, below,
                               Transposed(f), below);
}

// The later of the two has to be a row of the front that eliminates the earlier one.
bool SelectedInverse::Has(int i, int j) const {
  const int first = rows_.position(i) < rows_.position(j) ? i : j;
  // i + j − first is the other of the two.
  return rows_.RowIn(rows_.front_of(first), rows_.position(i + j - first)) >= 0;
}

// A pivot and any row of its front.
double SelectedInverse::Entry(int front, int pivot, int position) const {
  return Transposed(front)[static_cast<std::ptrdiff_t>(rows_.RowIn(front, position)) *
                               tree_.fronts[front].below() +
                           pivot];
}

double SelectedInverse::Diagonal(int block, int k) const {
  const int front = rows_.front_of(block);
  const int position = rows_.position(block) + k;
  return Entry(front, position - rows_.first_pivot(front), position);
}

// What is stored has rows of the block that is eliminated first; the caller wants those of i.
// Scalars of one block are consecutive in a front, whether pivots or not.
void SelectedInverse::Block(int i, int j, double* block) const {
  const bool turned = rows_.position(j) < rows_.position(i);  // the block of Σ₂₁ᵀ is that of (j, i)
  const int first = turned ? j : i, second = turned ? i : j;
  const int front = rows_.front_of(first);
  const double* from = Transposed(front) +
                       static_cast<std::ptrdiff_t>(rows_.RowIn(front, rows_.position(second))) *
                           tree_.fronts[front].below() +
                       rows_.position(first) - rows_.first_pivot(front);
  for (int c = 0; c < rows_.size(second); ++c, from += tree_.fronts[front].below()) {
    for (int r = 0; r < rows_.size(first); ++r) {
      block[turned ? c * rows_.size(first) + r : r * rows_.size(second) + c] = from[r];
    }
  }
}

}  // namespace inceres::internal
