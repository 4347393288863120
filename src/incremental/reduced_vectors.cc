#include "incremental/reduced_vectors.h"

#include <algorithm>

namespace inceres::internal {

// What a solver of S x = b gets beside S: b, diag(C), the damping and who is constant, packed by
// rows without padding. Rows are read when they have changed or have another offset; a change of μ
// or of its form touches the damping of all.
//
// Damping is μ diag C and not μ diag S, although S is what is damped (docs/algorithms.md, "Damping
// and trust region of incremental mode"): S_ii is a difference and may come out zero or negative.
//
// The pull of a frame, Σ_k b_k² / S'_kk, is kept for the active set, which grows from the largest.

namespace {

// Damps an entry that no factor touches, so that S has a factor.
constexpr double kTinyDiagonal = 1e-12;

// Times the diagonal of S: what it leaves of a step is far below what the step is exact to.
constexpr double kHoldingDamping = 1e12;

}  // namespace

// Sizes first, then b and the diagonals of the rows that have changed, and then their damping,
// which is made of the diagonals.
bool ReducedVectors::Refresh(DampingForm form, double mu, IncrementalSchur* schur) {
  const auto num_rows = static_cast<std::int32_t>(schur->frames().size());
  for (std::vector<double>* packed : {&weights_, &diagonal_, &damping_, &b_}) {
    packed->resize(schur->size());
  }
  pulls_.resize(num_rows);
  constant_.resize(num_rows);
  schur->changes().TakeUnread(&changed_);
  for (const std::int32_t row : changed_) {
    Read(*schur, row);
  }
  // The solver has another matrix then, and is told so by the result.
  if (mu != mu_ || form != form_) {
    mu_ = mu;
    form_ = form;
    for (std::int32_t row = 0; row < num_rows; ++row) {
      Damp(*schur, row);
    }
    return true;
  }
  for (const std::int32_t row : changed_) {
    Damp(*schur, row);
  }
  return false;
}

void ReducedVectors::Read(const IncrementalSchur& schur, std::int32_t row) {
  const IncrementalSchur::Frame& frame = schur.frames()[row];
  constant_[row] = frame.held ? 1 : 0;
  // A free row has no entries.
  if (frame.size == 0) {
    return;
  }
  const int offset = schur.FrameOffset(row);
  std::copy_n(schur.FrameDiagonal(row), frame.size, weights_.begin() + offset);
  if (frame.held) {
    std::fill_n(b_.begin() + offset, frame.size, 0.0);
  } else {
    std::copy_n(schur.b(row), frame.size, b_.begin() + offset);
  }
  // Its gradient points out of the box: it is no part of what the step can gain.
  const char* held = schur.HeldAtBounds(frame.quad);
  for (int k = 0; held != nullptr && k < frame.size; ++k) {
    b_[offset + k] = held[k] != 0 ? 0.0 : b_[offset + k];
  }
  // The diagonal block is the last one of its row, with rows padded to quads.
  const double* S = schur.S().values(schur.S().row(row).back().offset);
  for (int k = 0; k < frame.size; ++k) {
    diagonal_[offset + k] = S[k * (PadToQuad(frame.size) + 1)];
  }
}

void ReducedVectors::Damp(const IncrementalSchur& schur, std::int32_t row) {
  // The thesis's form is there for comparison.
  const std::vector<double>& scale = form_ == DampingForm::kThesis ? diagonal_ : weights_;
  const int offset = schur.FrameOffset(row), end = schur.FrameOffset(row + 1);
  if (constant_[row] != 0) {
    std::fill(damping_.begin() + offset, damping_.begin() + end, 1.0);
    pulls_[row] = 0.0;
    return;
  }
  for (int k = offset; k < end; ++k) {
    damping_[k] = mu_ * std::max(scale[k], kTinyDiagonal);
  }
  // A held coordinate stays in the matrix, so that its pattern does not change: with b of zero and
  // so much damping the step is zero but for rounding, and CutOff zeroes the rest.
  const char* held = schur.HeldAtBounds(schur.frames()[row].quad);
  for (int k = offset; held != nullptr && k < end; ++k) {
    if (held[k - offset] != 0) {
      damping_[k] = kHoldingDamping * std::max(diagonal_[k], kTinyDiagonal);
    }
  }
  pulls_[row] = Pull(schur, row, b_.data() + offset);
}

// Twice the gain of each scalar by itself, with all others where they are.
double ReducedVectors::Pull(const IncrementalSchur& schur, std::int32_t row,
                            const double* rhs) const {
  double pull = 0.0;
  if (constant_[row] != 0) {
    return pull;
  }
  const int offset = schur.FrameOffset(row);
  for (int k = offset; k < schur.FrameOffset(row + 1); ++k, ++rhs) {
    pull += *rhs * *rhs / (diagonal_[k] + damping_[k]);
  }
  return pull;
}

std::int64_t ReducedVectors::Bytes() const {
  std::size_t doubles = 0;
  for (const std::vector<double>* packed : {&weights_, &diagonal_, &damping_, &b_, &pulls_}) {
    doubles += packed->capacity();
  }
  return static_cast<std::int64_t>(sizeof(double) * doubles + constant_.capacity() +
                                   sizeof(std::int32_t) * changed_.capacity());
}

}  // namespace inceres::internal
