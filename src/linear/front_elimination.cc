#include "linear/front_elimination.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "linear/dense_panel.h"
#include "simd/kernels.h"

namespace inceres::internal {

// One front of a multifrontal factorization (Duff & Reid 1983; docs/algorithms.md, "Reduced linear
// systems"). With A₁₁ the block of the pivots and A₂₁ the rows below,
//
//     L₁ L₁ᵀ = A₁₁,    L₂ = A₂₁ L₁⁻ᵀ,    U −= L₂ L₂ᵀ,
//
// where U has begun as what the children leave to rows that are not pivots here. Both the batch
// factor and the Bayes tree work with this, each with memory of its own.
//
// L and U are column-major, of which the lower triangle counts, but the kernels take whole panels:
// the entries above the diagonal within a panel are written and mean nothing. Padding rows are
// zero, so that no kernel has a remainder to do. Strips and panels are cut by the front alone: a
// large front on several threads has the bits that it has on one.

namespace {

constexpr int kFrontPanel = 24;  // columns that the kernels take at a time; whole quads
// Rows a task: a multiple of every kernel's tile height, so that tasks do not change the
// arithmetic.
constexpr int kFrontStrip = 96;
// What is worth a task for each of a front's strips.
constexpr double kParallelFrontFlops = 2e6;

// Calls body(from, to) for strips of [begin, end): each a task if the front is large, else all in
// one.
template <typename Body>
void ForFrontStrips(const Front& front, const Executor& executor, int begin, int end, int strip,
                    const Body& body) {
  const int count = (end - begin + strip - 1) / strip;
  executor.For(count, front.flops() > kParallelFrontFlops ? 1 : count, [&](int first, int last) {
    for (int k = first; k < last; ++k) {
      body(begin + k * strip, std::min(begin + (k + 1) * strip, end));
    }
  });
}

// Columns of the front from `column` on, which are as far apart as their kind, pivots or not.
struct ColumnsOf {
  ColumnsOf(const Front& front, double* L, double* U, int column)
      : first(FrontColumn(front, L, U, column)),
        stride(column < front.below() ? front.stride() : front.update_stride()) {}

  double* first;
  int stride;
};

// The block of the child's rows `rows` and `count` columns from source on, which in the front begin
// with `column`. Rows come later than these in the child; in the front they may come earlier, and
// then the block is turned.
void AddUpdateBlock(const double* source, int source_stride, int column, int count,
                    const FrontRun& rows, const Front& front, double* L, double* U) {
  if (rows.to > column) {
    // Column by column on either side: along memory.
    const ColumnsOf target(front, L, U, column);
    return BestKernels().add_columns(rows.length, count, source, source_stride,
                                     target.first + rows.to, target.stride);
  }
  for (int r = 0; r < rows.length; ++r, ++source) {
    // What is a row of the child is a column of the front: the read is strided.
    double* target = FrontColumn(front, L, U, rows.to + r) + column;
    for (int c = 0; c < count; ++c) {
      target[c] += source[static_cast<std::ptrdiff_t>(c) * source_stride];
    }
  }
}

// A triangle on the diagonal, by strips of columns that begin there: up to three entries above it
// go along, which mean nothing.
void AddUpdateTriangle(const double* source, int source_stride, int size, int column,
                       const Front& front, double* L, double* U) {
  const ColumnsOf target(front, L, U, column);
  double* diagonal = target.first + column;
  for (int c = 0; c < size; c += kQuad) {
    BestKernels().add_columns(size - c, std::min(kQuad, size - c), source, source_stride, diagonal,
                              target.stride);
    source += kQuad * (source_stride + std::ptrdiff_t{1});
    diagonal += kQuad * (target.stride + std::ptrdiff_t{1});
  }
}

// Zeros in all that is read: of a column from the first row of its panel on. In the first panel
// that is everything, at once.
void ZeroColumns(int count, int num_rows, int stride, double* A) {
  const Kernels& kernels = BestKernels();
  const int whole = std::min(count, kFrontPanel);
  kernels.set_zero(std::int64_t{whole} * stride, A);
  for (int j = whole; j < count; ++j) {
    const int first = j / kFrontPanel * kFrontPanel;
    kernels.set_zero(num_rows - first, A + static_cast<std::ptrdiff_t>(j) * stride + first);
  }
}

}  // namespace

void ZeroFront(const Front& front, double* L, double* U) {
  ZeroColumns(front.width, front.num_rows(), front.stride(), L);
  ZeroColumns(front.height, front.update_stride(), front.update_stride(), U);
}

// Run by run rather than entry by entry: between two runs the places are consecutive on both sides.
// Only the columns of a run may lie apart, those of pivots and the others.
void AddUpdateMatrix(const Front& child, const double* child_update, const FrontRun* runs,
                     int num_runs, const Front& front, double* L, double* U) {
  const int stride = child.update_stride();
  for (int run = 0; run < num_runs; ++run) {
    const FrontRun& columns = runs[run];
    for (int done = 0; done < columns.length;) {
      const int from = columns.from + done, to = columns.to + done;
      const int rest = columns.length - done;
      const int count = to < front.below() ? std::min(rest, front.below() - to) : rest;
      const double* const source = child_update + static_cast<std::ptrdiff_t>(from) * stride;
      AddUpdateTriangle(source + from, stride, count, to, front, L, U);
      if (count < rest) {
        AddUpdateBlock(source + from + count, stride, to, count,
                       {from + count, to + count, rest - count}, front, L, U);
      }
      for (int other = run + 1; other < num_runs; ++other) {
        AddUpdateBlock(source + runs[other].from, stride, to, count, runs[other], front, L, U);
      }
      done += count;
    }
  }
}

// Left-looking within the pivots, then the update matrix at once.
int EliminateFront(const Front& front, double* L, double* U, const Executor& executor) {
  const Kernels& kernels = BestKernels();
  const int stride = front.stride();
  for (int first = 0; first < front.width; first += kFrontPanel) {
    const int width = std::min(kFrontPanel, front.width - first);
    double* panel = L + static_cast<std::ptrdiff_t>(first) * stride;
    // The pivots ahead of this panel, in one product a strip; rows beyond the pivots take part.
    if (first > 0) {
      ForFrontStrips(front, executor, first, front.num_rows(), kFrontStrip,
                     [&](int top, int bottom) {
                       kernels.subtract_outer(bottom - top, width, first, L + top, stride,
                                              L + first, stride, panel + top, stride);
                     });
    }
    int failed = 0;
    if (!FactorDiagonalBlock(panel + first, stride, width, &failed)) {
      return first + failed;
    }
    const int below = std::min(first + kFrontPanel, front.below());
    ForFrontStrips(front, executor, below, front.num_rows(), kFrontStrip, [&](int top, int bottom) {
      kernels.solve_lower_transposed(bottom - top, width, panel + first, stride, panel + top,
                                     stride);
    });
  }
  // U is one product with all pivots as its depth: read and written once.
  const double* rows = L + front.below();
  const int update_stride = front.update_stride();
  // By columns of U, and each from its own diagonal down.
  ForFrontStrips(front, executor, 0, front.height, kFrontPanel, [&](int first, int end) {
    BestKernels().subtract_lower_outer(
        update_stride - first, end - first, front.width, rows + first, stride,
        U + static_cast<std::ptrdiff_t>(first) * update_stride + first, update_stride);
  });
  return -1;
}

// A panel's triangle, then its rows below take their part out, those beyond the pivots included:
// what is in y₂ afterwards goes to the parent.
void SolveFrontForward(const Front& front, const double* L, double* y) {
  const int stride = front.stride();
  for (int first = 0; first < front.width; first += kFrontPanel) {
    const int width = std::min(kFrontPanel, front.width - first);
    const int below = std::min(first + kFrontPanel, front.below());
    const double* panel = L + static_cast<std::ptrdiff_t>(first) * stride;
    SolveTriangle(panel + first, stride, width, y + first);
    BestKernels().subtract_outer(front.num_rows() - below, 1, width, panel + below, stride,
                                 y + first, 1, y + below, front.num_rows());
  }
}

// Panel by panel as a single column. Row by row y is the transpose of what kernels know as X and C.
void SolveFrontForward(const Front& front, const double* L, int lanes, double* y) {
  if (lanes == 1) {
    return SolveFrontForward(front, L, y);
  }
  const int stride = front.stride();
  for (int first = 0; first < front.width; first += kFrontPanel) {
    const int width = std::min(kFrontPanel, front.width - first);
    const int below = std::min(first + kFrontPanel, front.below());
    const double* panel = L + static_cast<std::ptrdiff_t>(first) * stride;
    double* X = y + static_cast<std::ptrdiff_t>(first) * lanes;
    BestKernels().solve_lower_transposed(lanes, width, panel + first, stride, X, lanes);
    BestKernels().subtract_outer(lanes, front.num_rows() - below, width, X, lanes, panel + below,
                                 stride, y + static_cast<std::ptrdiff_t>(below) * lanes, lanes);
  }
}

// The other way round. y₂ is what the parents have found; it has to be there, and its padding zero.
void SolveFrontBackward(const Front& front, const double* L, double* y) {
  const int stride = front.stride();
  for (int first = (front.width - 1) / kFrontPanel * kFrontPanel; first >= 0;
       first -= kFrontPanel) {
    const int width = std::min(kFrontPanel, front.width - first);
    const int below = std::min(first + kFrontPanel, front.below());
    const double* panel = L + static_cast<std::ptrdiff_t>(first) * stride;
    BestKernels().subtract_row_dots(width, 1, front.num_rows() - below, panel + below, stride,
                                    y + below, front.num_rows(), y + first, 1);
    SolveTransposedTriangle(panel + first, stride, width, y + first);
  }
}

}  // namespace inceres::internal
