#include "linear/sparse_cholesky.h"

#include <algorithm>
#include <functional>

#include "linear/dense_panel.h"
#include "linear/front_elimination.h"
#include "linear/not_positive_definite.h"

namespace inceres::internal {

// The multifrontal factor L Lᵀ = S + diag of a batch solve (docs/algorithms.md, "Reduced linear
// systems"; Duff & Reid 1983; Liu 1992). BuildFrontTree has planned all that depends on the
// pattern: order, fronts, tasks, and where each front and update matrix is kept. Here the plan is
// carried out: assemble a front, add the update matrices of its children, eliminate its pivots
// (front_elimination.cc), pass U on.
//
// Tasks are segments of the tree. A segment begins when those before it are done, and takes its
// fronts in order; large fronts are cut into strips besides. Sums have the order that the plan
// gives them, whichever thread carries them out, so the bits do not depend on the number of
// threads.
//
// No copy of S is kept; A's blocks are read at each factorization. The factor, the update matrices
// and the fronts' parts of vectors stay allocated between calls. A failure is that of the first
// segment in the plan's order, and within it of the first front, whichever task met it first.

const char* SparseCholesky::Name() const {
  return tree_.dissected ? "sparse Cholesky, dissected" : "sparse Cholesky, AMD";
}

std::size_t SparseCholesky::Bytes() const {
  return tree_.Bytes() + (L_.size() + updates_.size() + vectors_.capacity()) * sizeof(double);
}

// Arrays only grow: a solve whose pattern changes little takes no new memory. Their contents need
// no zeros, since ZeroFront writes what is read.
Status SparseCholesky::Analyze(const ReducedMatrix& A) {
  pattern_ = &A.pattern();
  const Status built = BuildFrontTree(*pattern_, &tree_, /*may_dissect=*/true,
                                      /*one_by_one=*/executor_.num_threads() == 1);
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

// What Analyze has taken has not been touched: the new memory comes in its place.
double* SparseCholesky::PlaceValues(BlockPattern* pattern) {
  PlaceValuesInFactor(&tree_, pattern);
  if (L_.size() < tree_.factor_size) {
    L_ = ZeroedArray();  // first
    L_ = ZeroedArray(tree_.factor_size);
  }
  return L_.data();
}

// As Analyze would take it, if nothing were there.
double SparseCholesky::PredictedBytes() const {
  return static_cast<double>(tree_.Bytes() +
                             (tree_.factor_size + tree_.updates_size + tree_.vectors_size) *
                                 sizeof(double));
}

// Segment 0 is the one that all others come before. Everything is factored anew, whatever has
// changed.
Status SparseCholesky::Factorize(const ReducedMatrix& A, const Rows& /*changed*/) {
  work_.factor_flops = tree_.flops;
  const int failed = FactorSegment(0, A);
  return End(failed, failed == FrontTree::kNone ? failed : A.RowId(failed));
}

// `failed`: the block of S at which there is no factor; or none. `row`: what it is called.
Status SparseCholesky::End(int failed, int row) {
  failed_at_ = failed;
  factored_ = failed == FrontTree::kNone ? Status::Ok() : NotPositiveDefinite(row, &work_);
  return factored_;
}

// One task a segment. Segments before a segment are independent of each other, and tasks may open
// further ones.
template <typename Body>
void SparseCholesky::ForSegmentsBefore(const FrontSegment& segment, const Body& body) const {
  executor_.For(static_cast<int>(segment.before.size()), 1, [&](int begin, int end) {
    std::for_each(segment.before.begin() + begin, segment.before.begin() + end, body);
  });
}

// Children of another segment wait until their parent is opened. Those of the same segment may be
// added as they come, where the plan says that keeping them would take more memory than the parent
// itself.
int SparseCholesky::FactorSegment(int index, const ReducedMatrix& A) {
  const FrontSegment& segment = tree_.segments[index];
  ForSegmentsBefore(segment, [&](int before) { FactorSegment(before, A); });
  // Each segment writes its own entry only; what came before is asked in the plan's order.
  int& failed = failed_[index];
  failed = FrontTree::kNone;
  for (const int before : segment.before) {
    failed = failed == FrontTree::kNone ? failed_[before] : failed;
  }
  for (auto f = segment.fronts.begin(); f != segment.fronts.end() && failed == FrontTree::kNone;
       ++f) {
    // A parent that takes updates as they come was opened by its first child.
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
// Their order is that of the fronts.
void SparseCholesky::Open(int f, const ReducedMatrix& A) {
  Assemble(f, A);
  const Front& front = tree_.fronts[f];
  for (int k = front.child_begin; k < front.child_end; ++k) {
    if (!tree_.IsTakenEarly(tree_.children[k])) {
      AddUpdate(tree_.children[k], f);
    }
  }
}

// The blocks of S whose earlier row is a pivot here, each at the place that the plan has for it,
// then the diagonal.
void SparseCholesky::Assemble(int f, const ReducedMatrix& A) {
  const Front& front = tree_.fronts[f];
  const BlockPattern& pattern = *pattern_;
  double* const L = Column(f, 0);
  // Once for all blocks, which are small.
  const int stride = front.stride();
  ZeroFront(front, L, Update(f));
  for (int k = front.piece_begin; k < front.piece_end; ++k) {
    const FrontPiece& piece = tree_.pieces[k];
    // Null: the block is left out, and its place keeps its zeros.
    if (const double* block = A.Block(piece.i, piece.block)) {
      const int j = pattern.columns[piece.block];
      PlaceBlock(block, pattern.row_stride(j), pattern.block_size(piece.i), pattern.block_size(j),
                 piece.row, piece.column, L, stride);
    }
  }
  // Pivots of a front are blocks one behind the other.
  double* pivot = L;
  const double* const diagonal = A.diagonal();
  for (int at = front.position_begin; at < front.position_end; ++at) {
    const int block = tree_.order[at];
    const int end = pattern.offsets[block + 1];
    for (int row = pattern.offsets[block]; row < end; ++row, pivot += stride + 1) {
      *pivot += diagonal[row];
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

// From a scalar pivot to the block of S that has it: what a message can name.
int SparseCholesky::BlockAtPivot(const Front& front, int pivot) const {
  int at = front.position_begin;
  while (pivot >= pattern_->block_size(tree_.order[at])) {
    pivot -= pattern_->block_size(tree_.order[at++]);
  }
  return tree_.order[at];
}

// Forwards children first, backwards parents first, with the same segments: y = L⁻¹ b, then
// x = L⁻ᵀ y. All of b and x is done.
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

// The other way round: this segment's fronts, last one first, then the segments before it, side by
// side.
void SparseCholesky::SolveBackward(const FrontSegment& segment, double* x) {
  for (auto f = segment.fronts.rbegin(); f != segment.fronts.rend(); ++f) {
    SolveBackward(*f, x);
  }
  ForSegmentsBefore(segment, [&](int before) { SolveBackward(tree_.segments[before], x); });
}

// A front's part of the vector has a place for each of its rows: the pivots take b, the others
// begin with zero and collect what the parent is to add. No two fronts write to the same place.
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
    // What the child's rows beyond its pivots have collected.
    const double* update = Vector(tree_.children[k]) + child.below();
    for (int run = child.run_begin; run < child.run_end; ++run) {
      const auto [from, to, length] = tree_.runs[run];
      std::transform(update + from, update + from + length, y + to, y + to, std::plus<>());
    }
  }
  SolveFrontForward(front, Column(f, 0), y);
}

// The rows beyond the pivots take x from the parent, whose part is complete by then; the padding
// stays zero from the way forwards.
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
