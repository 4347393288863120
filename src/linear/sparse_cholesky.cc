#include "linear/sparse_cholesky.h"

#include <algorithm>
#include <functional>
#include <string>

#include "linear/dense_panel.h"
#include "simd/kernels.h"

namespace inceres::internal {
namespace {

constexpr int kPanel = 24;  // columns that the kernels take at a time; whole quads
// Rows a task: a multiple of every kernel's tile height, so that tasks do not change the
// arithmetic.
constexpr int kRowStrip = 96;
// What is worth a task for each of a front's strips.
constexpr double kParallelFrontFlops = 2e6;

}  // namespace

const char* SparseCholesky::Name() const {
  return tree_.dissected ? "sparse Cholesky, dissected" : "sparse Cholesky, AMD";
}

std::size_t SparseCholesky::Bytes() const {
  return tree_.Bytes() + (L_.size() + updates_.size() + vectors_.capacity()) * sizeof(double);
}

Status SparseCholesky::Analyze(const ReducedMatrix& A) {
  pattern_ = &A.pattern();
  const Status built = BuildFrontTree(*pattern_, &tree_);
  if (!built.ok()) {
    return built;
  }
  if (L_.size() < tree_.factor_size) {
    L_ = ZeroedArray(tree_.factor_size);
  }
  if (updates_.size() < tree_.updates_size) {
    updates_ = ZeroedArray(tree_.updates_size);
  }
  vectors_.assign(tree_.vectors_size, 0.0);
  failed_.assign(tree_.segments.size(), FrontTree::kNone);
  return built;
}

double SparseCholesky::PredictedBytes() const {
  return static_cast<double>(tree_.Bytes() +
                             (tree_.factor_size + tree_.updates_size + tree_.vectors_size) *
                                 sizeof(double));
}

Status SparseCholesky::Factorize(const ReducedMatrix& A, const Rows& /*changed*/) {
  work_.factor_flops = tree_.flops;
  const int failed = FactorSegment(0, A);
  factored_ = failed == FrontTree::kNone
                  ? Status::Ok()
                  : Status::Error(StatusCode::kSingular,
                                  "the reduced system is not positive definite at frame " +
                                      std::to_string(failed));
  return factored_;
}

template <typename Body>
void SparseCholesky::ForSegmentsBefore(const FrontSegment& segment, const Body& body) const {
  executor_.For(static_cast<int>(segment.before.size()), 1, [&](int begin, int end) {
    std::for_each(segment.before.begin() + begin, segment.before.begin() + end, body);
  });
}

int SparseCholesky::FactorSegment(int index, const ReducedMatrix& A) {
  const FrontSegment& segment = tree_.segments[index];
  ForSegmentsBefore(segment, [&](int before) { FactorSegment(before, A); });
  int& failed = failed_[index];
  failed = FrontTree::kNone;
  for (const int before : segment.before) {
    failed = failed == FrontTree::kNone ? failed_[before] : failed;
  }
  for (auto f = segment.fronts.begin(); f != segment.fronts.end() && failed == FrontTree::kNone;
       ++f) {
    if (tree_.opened_by[*f] == FrontTree::kNone) {
      Open(*f, A);
    }
    failed = Eliminate(*f);
    if (failed == FrontTree::kNone && tree_.IsTakenEarly(*f)) {
      const int parent = tree_.fronts[*f].parent;
      if (tree_.opened_by[parent] == *f) {
        Open(parent, A);
      }
      AddUpdate(*f, parent);
    }
  }
  return failed;
}

// With the update matrices of all children that are not added as they come.
void SparseCholesky::Open(int f, const ReducedMatrix& A) {
  Assemble(f, A);
  const Front& front = tree_.fronts[f];
  for (int k = front.child_begin; k < front.child_end; ++k) {
    if (!tree_.IsTakenEarly(tree_.children[k])) {
      AddUpdate(tree_.children[k], f);
    }
  }
}

void SparseCholesky::Assemble(int f, const ReducedMatrix& A) {
  const Front& front = tree_.fronts[f];
  for (int j = 0; j < front.width; ++j) {
    std::fill(Column(f, j) + j / kPanel * kPanel, Column(f, j) + front.num_rows(), 0.0);
  }
  for (int j = 0; j < front.height; ++j) {
    double* column = Update(f) + static_cast<std::ptrdiff_t>(j) * front.update_stride();
    std::fill(column + j / kPanel * kPanel, column + front.update_stride(), 0.0);
  }
  for (int k = front.piece_begin; k < front.piece_end; ++k) {
    const FrontPiece& piece = tree_.pieces[k];
    if (const double* block = A.Block(piece.i, piece.block)) {
      const int j = pattern_->columns[piece.block];
      PlaceBlock(block, pattern_->row_stride(j), pattern_->block_size(piece.i),
                 pattern_->block_size(j), piece.row, piece.column, Column(f, 0), front.stride());
    }
  }
  int pivot = 0;
  for (int at = front.position_begin; at < front.position_end; ++at) {
    const int block = tree_.order[at];
    for (int row = pattern_->offsets[block]; row < pattern_->offsets[block + 1]; ++row, ++pivot) {
      Column(f, pivot)[pivot] += A.diagonal()[row];
    }
  }
}

void SparseCholesky::AddUpdate(int child, int f) {
  const Front& from = tree_.fronts[child];
  const Front& to = tree_.fronts[f];
  for (int run = from.run_begin; run < from.run_end; ++run) {
    const FrontRun& columns = tree_.runs[run];
    for (int c = 0; c < columns.length; ++c) {
      const int j = columns.to + c;
      const double* source =
          Update(child) + static_cast<std::ptrdiff_t>(columns.from + c) * from.update_stride();
      double* target = j < to.below()
                           ? Column(f, j)
                           : Update(f) +
                                 static_cast<std::ptrdiff_t>(j - to.below()) * to.update_stride() -
                                 to.below();
      for (int r = c; r < columns.length; ++r) {
        target[columns.to + r] += source[columns.from + r];
      }
      for (int other = run + 1; other < from.run_end; ++other) {
        const FrontRun& rows = tree_.runs[other];
        for (int r = 0; r < rows.length; ++r) {
          target[rows.to + r] += source[rows.from + r];
        }
      }
    }
  }
}

template <typename Body>
void SparseCholesky::ForStrips(const Front& front, int begin, int end, int strip,
                               const Body& body) const {
  const int count = (end - begin + strip - 1) / strip;
  executor_.For(count, front.flops() > kParallelFrontFlops ? 1 : count, [&](int first, int last) {
    for (int k = first; k < last; ++k) {
      body(begin + k * strip, std::min(begin + (k + 1) * strip, end));
    }
  });
}

// Left-looking within the pivots, then the update matrix at once.
int SparseCholesky::Eliminate(int f) {
  const Kernels& kernels = BestKernels();
  const Front& front = tree_.fronts[f];
  const int stride = front.stride();
  for (int first = 0; first < front.width; first += kPanel) {
    const int width = std::min(kPanel, front.width - first);
    double* panel = Column(f, first);
    if (first > 0) {
      ForStrips(front, first, front.num_rows(), kRowStrip, [&](int top, int bottom) {
        kernels.subtract_outer(bottom - top, width, first, Column(f, 0) + top, stride,
                               Column(f, 0) + first, stride, panel + top, stride);
      });
    }
    int failed = 0;
    if (!FactorDiagonalBlock(panel + first, stride, width, &failed)) {
      return BlockAtPivot(front, first + failed);
    }
    const int below = std::min(first + kPanel, front.below());
    ForStrips(front, below, front.num_rows(), kRowStrip, [&](int top, int bottom) {
      kernels.solve_lower_transposed(bottom - top, width, panel + first, stride, panel + top,
                                     stride);
    });
  }
  const double* rows = Column(f, 0) + front.below();
  ForStrips(front, 0, front.height, kPanel, [&](int first, int end) {
    kernels.subtract_outer(
        front.update_stride() - first, end - first, front.width, rows + first, stride, rows + first,
        stride, Update(f) + static_cast<std::ptrdiff_t>(first) * front.update_stride() + first,
        front.update_stride());
  });
  return FrontTree::kNone;
}

int SparseCholesky::BlockAtPivot(const Front& front, int pivot) const {
  int at = front.position_begin;
  while (pivot >= pattern_->block_size(tree_.order[at])) {
    pivot -= pattern_->block_size(tree_.order[at++]);
  }
  return tree_.order[at];
}

Status SparseCholesky::Solve(const double* b, const Rows& /*changed_b*/,
                             const Truncation& /*truncation*/, double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  SolveForward(tree_.segments.front(), b);
  SolveBackward(tree_.segments.front(), x);
  return Status::Ok();
}

void SparseCholesky::SolveForward(const FrontSegment& segment, const double* b) {
  ForSegmentsBefore(segment, [&](int before) { SolveForward(tree_.segments[before], b); });
  for (const int f : segment.fronts) {
    SolveForward(f, b);
  }
}

void SparseCholesky::SolveBackward(const FrontSegment& segment, double* x) {
  for (auto f = segment.fronts.rbegin(); f != segment.fronts.rend(); ++f) {
    SolveBackward(*f, x);
  }
  ForSegmentsBefore(segment, [&](int before) { SolveBackward(tree_.segments[before], x); });
}

void SparseCholesky::SolveForward(int f, const double* b) {
  const Front& front = tree_.fronts[f];
  double* y = Vector(f);
  double* pivot = y;
  for (int at = front.position_begin; at < front.position_end; ++at) {
    const int block = tree_.order[at];
    pivot = std::copy_n(b + pattern_->offsets[block], pattern_->block_size(block), pivot);
  }
  std::fill(pivot, y + front.num_rows(), 0.0);
  for (int k = front.child_begin; k < front.child_end; ++k) {
    const Front& child = tree_.fronts[tree_.children[k]];
    const double* update = Vector(tree_.children[k]) + child.below();
    for (int run = child.run_begin; run < child.run_end; ++run) {
      const auto [from, to, length] = tree_.runs[run];
      std::transform(update + from, update + from + length, y + to, y + to, std::plus<>());
    }
  }
  for (int first = 0; first < front.width; first += kPanel) {
    const int width = std::min(kPanel, front.width - first);
    const int below = std::min(first + kPanel, front.below());
    SolveTriangle(Column(f, first) + first, front.stride(), width, y + first);
    BestKernels().subtract_outer(front.num_rows() - below, 1, width, Column(f, first) + below,
                                 front.stride(), y + first, 1, y + below, front.num_rows());
  }
}

void SparseCholesky::SolveBackward(int f, double* x) {
  const Front& front = tree_.fronts[f];
  double* y = Vector(f);
  for (int run = front.run_begin; run < front.run_end; ++run) {
    const auto [from, to, length] = tree_.runs[run];
    std::copy_n(Vector(front.parent) + to, length, y + front.below() + from);
  }
  for (int first = (front.width - 1) / kPanel * kPanel; first >= 0; first -= kPanel) {
    const int width = std::min(kPanel, front.width - first);
    const int below = std::min(first + kPanel, front.below());
    BestKernels().subtract_row_dots(width, 1, front.num_rows() - below, Column(f, first) + below,
                                    front.stride(), y + below, front.num_rows(), y + first, 1);
    SolveTransposedTriangle(Column(f, first) + first, front.stride(), width, y + first);
  }
  const double* pivot = y;
  for (int at = front.position_begin; at < front.position_end; ++at) {
    const int block = tree_.order[at];
    std::copy_n(pivot, pattern_->block_size(block), x + pattern_->offsets[block]);
    pivot += pattern_->block_size(block);
  }
}

}  // namespace inceres::internal
