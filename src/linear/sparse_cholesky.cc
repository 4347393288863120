#include "linear/sparse_cholesky.h"

#include <algorithm>
#include <functional>
#include <string>

#include "linear/dense_panel.h"
#include "simd/kernels.h"

namespace inceres::internal {
namespace {

constexpr int kNone = -1;
constexpr int kPanel = 24;  // columns that the kernels take at a time; whole quads
// Rows a task: a multiple of every kernel's tile height, so that tasks do not change the arithmetic.
constexpr int kRowStrip = 96;

// What is worth a task of its own: a subtree of so many flops, and of such a share of all; a front's strips.
constexpr double kHeavyFlops = 1e6;
constexpr double kHeavyShare = 1.0 / 32;
constexpr double kParallelFrontFlops = 2e6;

// Memory of update matrices: the lowest gap, while the others wait.
class UpdatePlanner {
 public:
  std::size_t Place(std::size_t size) {
    if (size == 0) {
      return 0;  // of a root, which no parent frees
    }
    std::size_t begin = 0;
    auto at = waiting_.begin();
    for (; at != waiting_.end() && at->begin < begin + size; ++at) {
      begin = at->end;
    }
    waiting_.insert(at, {begin, begin + size});
    peak_ = std::max(peak_, begin + size);
    return begin;
  }
  void Free(std::size_t begin) {
    waiting_.erase(std::find_if(waiting_.begin(), waiting_.end(), [begin](const Piece& piece) { return piece.begin == begin; }));
  }
  std::size_t peak() const { return peak_; }

 private:
  struct Piece {
    std::size_t begin, end;
  };
  std::vector<Piece> waiting_;  // ascending
  std::size_t peak_ = 0;
};

}  // namespace

const char* SparseCholesky::Name() const {
  return tree_.dissected ? "sparse Cholesky, dissected" : "sparse Cholesky, AMD";
}

std::size_t SparseCholesky::Bytes() const {
  return tree_.Bytes() + (L_.size() + updates_.size() + vectors_.capacity()) * sizeof(double);
}

Status SparseCholesky::Analyze(const BlockPattern& pattern) {
  const Status planned = Plan(pattern, /*may_dissect=*/true);
  if (!planned.ok()) {
    return planned;
  }
  if (L_.size() < factor_size_) {
    L_ = ZeroedArray(factor_size_);
  }
  if (updates_.size() < updates_size_) {
    updates_ = ZeroedArray(updates_size_);
  }
  vectors_.assign(vectors_size_, 0.0);
  return planned;
}

Status SparseCholesky::Plan(const BlockPattern& pattern, bool may_dissect) {
  pattern_ = &pattern;
  const Status built = BuildFrontTree(pattern, &tree_, may_dissect);
  if (built.ok()) {
    CutIntoSegments();
    ChooseEarlyFronts();
    PlanMemory();
  }
  return built;
}

double SparseCholesky::PredictedBytes() const {
  return static_cast<double>(tree_.Bytes() + (factor_size_ + updates_size_ + vectors_size_) * sizeof(double));
}

// A heavy subtree beside another one begins a segment; everything else goes with its parent.
void SparseCholesky::CutIntoSegments() {
  const auto num_fronts = static_cast<int>(tree_.fronts.size());
  std::vector<double> flops(tree_.fronts.size(), 0.0);     // of subtrees
  std::vector<int> num_heavy(tree_.fronts.size() + 1, 0);  // children, and last the roots
  const auto parent_or_last = [&](int f) { return tree_.fronts[f].parent < 0 ? num_fronts : tree_.fronts[f].parent; };
  const auto is_heavy = [&](int f) { return flops[f] > std::max(kHeavyFlops, kHeavyShare * tree_.flops); };
  for (int f = 0; f < num_fronts; ++f) {
    flops[f] += tree_.fronts[f].flops();
    num_heavy[parent_or_last(f)] += is_heavy(f) ? 1 : 0;
    if (tree_.fronts[f].parent >= 0) {
      flops[tree_.fronts[f].parent] += flops[f];
    }
  }
  segments_.assign(1, Segment());
  segment_of_.assign(tree_.fronts.size() + 1, 0);
  for (int f = num_fronts - 1; f >= 0; --f) {
    const int parent = parent_or_last(f);
    segment_of_[f] = segment_of_[parent];
    if (is_heavy(f) && num_heavy[parent] > 1) {
      segment_of_[f] = static_cast<int>(segments_.size());
      segments_[segment_of_[parent]].before.push_back(segment_of_[f]);
      segments_.emplace_back();
    }
  }
  for (int f = 0; f < num_fronts; ++f) {
    segments_[segment_of_[f]].fronts.push_back(f);
  }
}

// A front that takes less than its children's update matrices together opens when the first of them is there.
void SparseCholesky::ChooseEarlyFronts() {
  opened_by_.assign(tree_.fronts.size(), kNone);
  for (std::size_t f = 0; f < tree_.fronts.size(); ++f) {
    const Front& front = tree_.fronts[f];
    std::size_t waiting = 0;
    int first = kNone;
    int last = kNone;
    for (int k = front.child_begin; k < front.child_end; ++k) {
      const int child = tree_.children[k];
      if (segment_of_[child] == segment_of_[f]) {
        waiting += last == kNone ? 0 : UpdateSize(last);
        first = first == kNone ? child : first;
        last = child;
      }
    }
    opened_by_[f] = waiting > UpdateSize(static_cast<int>(f)) ? first : kNone;
  }
}

void SparseCholesky::PlanMemory() {
  factor_begin_.clear();
  vector_begin_.clear();
  factor_size_ = vectors_size_ = updates_size_ = 0;
  for (const Front& front : tree_.fronts) {
    factor_begin_.push_back(factor_size_);
    vector_begin_.push_back(vectors_size_);
    factor_size_ += static_cast<std::size_t>(front.stride()) * front.width;
    vectors_size_ += static_cast<std::size_t>(front.num_rows());
  }
  update_begin_.assign(tree_.fronts.size(), 0);
  for (const Segment& segment : segments_) {
    updates_size_ += PlanUpdates(segment, updates_size_);
  }
}

// Places the update matrices of a segment's fronts from `begin` on; those of children in other segments stay where they are. What
// they take.
std::size_t SparseCholesky::PlanUpdates(const Segment& segment, std::size_t begin) {
  UpdatePlanner planner;
  const auto place = [&](int f) { update_begin_[f] = begin + planner.Place(UpdateSize(f)); };
  for (const int f : segment.fronts) {
    const Front& front = tree_.fronts[f];
    if (opened_by_[f] == kNone) {
      place(f);
      for (int k = front.child_begin; k < front.child_end; ++k) {
        const int child = tree_.children[k];
        if (segment_of_[child] == segment_of_[f]) {
          planner.Free(update_begin_[child] - begin);
        }
      }
    }
    if (IsTakenEarly(f)) {
      if (opened_by_[front.parent] == f) {
        place(front.parent);
      }
      planner.Free(update_begin_[f] - begin);
    }
  }
  return planner.peak();
}

Status SparseCholesky::Factorize(const double* values, const double* diagonal) {
  FactorSegment(&segments_.front(), values, diagonal);
  const int failed = segments_.front().failed;
  return failed == kNone ? Status::Ok()
                         : Status::Error(StatusCode::kSingular,
                                         "the reduced system is not positive definite at frame " + std::to_string(failed));
}

template <typename Body>
void SparseCholesky::ForSegmentsBefore(const Segment& segment, const Body& body) const {
  executor_.For(static_cast<int>(segment.before.size()), 1,
                [&](int begin, int end) { std::for_each(segment.before.begin() + begin, segment.before.begin() + end, body); });
}

void SparseCholesky::FactorSegment(Segment* segment, const double* values, const double* diagonal) {
  ForSegmentsBefore(*segment, [&](int before) { FactorSegment(&segments_[before], values, diagonal); });
  segment->failed = kNone;
  for (const int before : segment->before) {
    if (segment->failed == kNone) {
      segment->failed = segments_[before].failed;
    }
  }
  for (auto f = segment->fronts.begin(); f != segment->fronts.end() && segment->failed == kNone; ++f) {
    if (opened_by_[*f] == kNone) {
      Open(*f, values, diagonal);
    }
    segment->failed = Eliminate(*f);
    if (segment->failed == kNone && IsTakenEarly(*f)) {
      const int parent = tree_.fronts[*f].parent;
      if (opened_by_[parent] == *f) {
        Open(parent, values, diagonal);
      }
      AddUpdate(*f, parent);
    }
  }
}

// With the update matrices of all children that are not added as they come.
void SparseCholesky::Open(int f, const double* values, const double* diagonal) {
  Assemble(f, values, diagonal);
  const Front& front = tree_.fronts[f];
  for (int k = front.child_begin; k < front.child_end; ++k) {
    if (!IsTakenEarly(tree_.children[k])) {
      AddUpdate(tree_.children[k], f);
    }
  }
}

void SparseCholesky::Assemble(int f, const double* values, const double* diagonal) {
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
    PlaceBlock(values + piece.values, piece.rows, piece.columns, piece.row, piece.column, Column(f, 0), front.stride());
  }
  int pivot = 0;
  for (int at = front.position_begin; at < front.position_end; ++at) {
    const int block = tree_.order[at];
    for (int row = pattern_->offsets[block]; row < pattern_->offsets[block + 1]; ++row, ++pivot) {
      Column(f, pivot)[pivot] += diagonal[row];
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
      const double* source = Update(child) + static_cast<std::ptrdiff_t>(columns.from + c) * from.update_stride();
      double* target = j < to.below() ? Column(f, j)
                                      : Update(f) + static_cast<std::ptrdiff_t>(j - to.below()) * to.update_stride() - to.below();
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
void SparseCholesky::ForStrips(const Front& front, int begin, int end, int strip, const Body& body) const {
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
        kernels.subtract_outer(bottom - top, width, first, Column(f, 0) + top, stride, Column(f, 0) + first, stride, panel + top,
                               stride);
      });
    }
    int failed = 0;
    if (!FactorDiagonalBlock(panel + first, stride, width, &failed)) {
      return BlockAtPivot(front, first + failed);
    }
    const int below = std::min(first + kPanel, front.below());
    ForStrips(front, below, front.num_rows(), kRowStrip, [&](int top, int bottom) {
      kernels.solve_lower_transposed(bottom - top, width, panel + first, stride, panel + top, stride);
    });
  }
  const double* rows = Column(f, 0) + front.below();
  ForStrips(front, 0, front.height, kPanel, [&](int first, int end) {
    kernels.subtract_outer(front.update_stride() - first, end - first, front.width, rows + first, stride, rows + first, stride,
                           Update(f) + static_cast<std::ptrdiff_t>(first) * front.update_stride() + first, front.update_stride());
  });
  return kNone;
}

int SparseCholesky::BlockAtPivot(const Front& front, int pivot) const {
  int at = front.position_begin;
  while (pivot >= pattern_->block_size(tree_.order[at])) {
    pivot -= pattern_->block_size(tree_.order[at++]);
  }
  return tree_.order[at];
}

Status SparseCholesky::Solve(const double* b, double* x) {
  SolveForward(segments_.front(), b);
  SolveBackward(segments_.front(), x);
  return Status::Ok();
}

void SparseCholesky::SolveForward(const Segment& segment, const double* b) {
  ForSegmentsBefore(segment, [&](int before) { SolveForward(segments_[before], b); });
  for (const int f : segment.fronts) {
    SolveForward(f, b);
  }
}

void SparseCholesky::SolveBackward(const Segment& segment, double* x) {
  for (auto f = segment.fronts.rbegin(); f != segment.fronts.rend(); ++f) {
    SolveBackward(*f, x);
  }
  ForSegmentsBefore(segment, [&](int before) { SolveBackward(segments_[before], x); });
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
    BestKernels().subtract_outer(front.num_rows() - below, 1, width, Column(f, first) + below, front.stride(), y + first, 1,
                                 y + below, front.num_rows());
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
    BestKernels().subtract_row_dots(width, 1, front.num_rows() - below, Column(f, first) + below, front.stride(), y + below,
                                    front.num_rows(), y + first, 1);
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
