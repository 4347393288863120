#include "linear/sparse_cholesky.h"

#include <algorithm>
#include <functional>
#include <string>

#include "linear/dense_panel.h"
#include "linear/front_elimination.h"

namespace inceres::internal {

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
  return End(FactorSegment(0, A));
}

// `failed`: the block of S at which there is no factor; or none.
Status SparseCholesky::End(int failed) {
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
  ZeroFront(front, Column(f, 0), Update(f));
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
  AddUpdateMatrix(from, Update(child), tree_.runs.data() + from.run_begin,
                  from.run_end - from.run_begin, tree_.fronts[f], Column(f, 0), Update(f));
}

int SparseCholesky::Eliminate(int f) {
  const int failed = EliminateFront(tree_.fronts[f], Column(f, 0), Update(f), executor_);
  return failed < 0 ? FrontTree::kNone : BlockAtPivot(tree_.fronts[f], failed);
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
  SolveFrontForward(front, Column(f, 0), y);
}

void SparseCholesky::SolveBackward(int f, double* x) {
  const Front& front = tree_.fronts[f];
  double* y = Vector(f);
  for (int run = front.run_begin; run < front.run_end; ++run) {
    const auto [from, to, length] = tree_.runs[run];
    std::copy_n(Vector(front.parent) + to, length, y + front.below() + from);
  }
  SolveFrontBackward(front, Column(f, 0), y);
  const double* pivot = y;
  for (int at = front.position_begin; at < front.position_end; ++at) {
    const int block = tree_.order[at];
    std::copy_n(pivot, pattern_->block_size(block), x + pattern_->offsets[block]);
    pivot += pattern_->block_size(block);
  }
}

}  // namespace inceres::internal
