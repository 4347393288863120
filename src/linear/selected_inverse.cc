#include "linear/selected_inverse.h"

#include <algorithm>

#include <Eigen/Dense>

#include "simd/kernels.h"

namespace inceres::internal {
namespace {

using Eigen::MatrixXd;
using Strided = Eigen::Map<MatrixXd, 0, Eigen::OuterStride<>>;
using ConstStrided = Eigen::Map<const MatrixXd, 0, Eigen::OuterStride<>>;

// Columns a task: a multiple of what the kernels take at a time, so that tasks do not change the
// arithmetic.
constexpr int kStrip = 48;
constexpr double kParallelFlops = 2e6;

}  // namespace

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
  for (int f = num_fronts - 1; f >= 0; --f) {
    Invert(factor, f, executor);
  }
}

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
  if (front.child_begin == front.child_end) {
    waiting_[f] = Waiting();
  }
  // Fronts come parents first, so the first child is the last to ask.
  if (front.parent >= 0 && tree_.children[tree_.fronts[front.parent].child_begin] == f) {
    waiting_[front.parent] = Waiting();
  }
}

// Entry of A⁻¹ at two rows of the front, row ≥ column.
double SelectedInverse::FromParent(int parent, int row, int column) const {
  const Front& front = tree_.fronts[parent];
  if (column >= front.below()) {
    const Waiting& rest = waiting_[parent];
    return rest.values[static_cast<std::size_t>(column - front.below()) * rest.stride + row -
                       front.below()];
  }
  const int at = row < front.below() ? row : front.width + row - front.below();
  return Transposed(parent)[static_cast<std::ptrdiff_t>(at) * front.below() + column];
}

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

// Σ₁₁ = (L₁ L₁ᵀ)⁻¹ for now, and T = Mᵀ = L₁⁻ᵀ L₂ᵀ.
void SelectedInverse::InvertPivots(const SparseCholesky& factor, int f) {
  const Front& front = tree_.fronts[f];
  const ConstStrided L(factor.Column(f, 0), front.num_rows(), front.width,
                       Eigen::OuterStride<>(front.stride()));
  const auto L_1 = L.topRows(front.width).triangularView<Eigen::Lower>();
  MatrixXd inverse = MatrixXd::Identity(front.width, front.width);
  L_1.solveInPlace(inverse);
  Strided pivots(Transposed(f), front.width, front.width, Eigen::OuterStride<>(front.below()));
  pivots.noalias() = inverse.triangularView<Eigen::Lower>().transpose() * inverse;
  T_.assign(static_cast<std::size_t>(front.below()) * front.height, 0.0);
  Strided T(T_.data(), front.width, front.height, Eigen::OuterStride<>(front.below()));
  T = L.middleRows(front.below(), front.height).transpose();
  L_1.transpose().solveInPlace(T);
}

// Σ₂₁ᵀ = −T Σ₂₂, Σ₁₁ −= T Σ₂₁.
void SelectedInverse::Eliminate(int f, const Executor& executor) {
  const Front& front = tree_.fronts[f];
  const Waiting& rest = waiting_[f];
  const int below = front.below();
  double* others = Transposed(f) + static_cast<std::ptrdiff_t>(front.width) * below;
  const int count = (front.height + kStrip - 1) / kStrip;
  executor.For(count, front.flops() > kParallelFlops ? 1 : count, [&](int first, int end) {
    for (int k = first; k < end; ++k) {
      const int column = k * kStrip;
      BestKernels().subtract_outer(below, std::min(kStrip, front.height - column), front.height,
                                   T_.data(), below, rest.values.data() + column, rest.stride,
                                   others + static_cast<std::ptrdiff_t>(column) * below, below);
    }
  });
  BestKernels().subtract_outer(below, front.width, front.height, T_.data(), below, others, below,
                               Transposed(f), below);
}

bool SelectedInverse::Has(int i, int j) const {
  const int first = rows_.position(i) < rows_.position(j) ? i : j;
  return rows_.RowIn(rows_.front_of(first), rows_.position(i + j - first)) >= 0;
}

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
