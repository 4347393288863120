#include "incremental/weak_variables.h"

#include <cstddef>

#include "linear/small_cholesky.h"

namespace inceres::internal {
namespace {

// Of the entry of diag C: what may be nothing but rounding of S.
constexpr double kRounding = 1e-10;

}  // namespace

void WeakVariables::Follow() {
  frames_.Grow(schur_.frames().size());
  schur_.changes().TakeUnjudged(&changed_);
  for (const std::int32_t frame : changed_) {
    frames_.Remove(frame);
    if (!schur_.frames()[frame].held && IsWeak(frame)) {
      frames_.Add(frame);
    }
  }
}

// By its own block: what the pivots of the whole of S are, is the order of elimination's.
bool WeakVariables::IsWeak(std::int32_t frame) {
  const int size = schur_.frames()[frame].size;
  if (size == 0) {
    return false;
  }
  const double* diagonal = schur_.FrameDiagonal(frame);
  const double* S = schur_.S().values(schur_.S().row(frame).back().offset);
  const auto stride = static_cast<std::ptrdiff_t>(PadToQuad(size));
  block_.assign(S, S + size * stride);
  for (int k = 0; k < size; ++k) {
    block_[static_cast<std::size_t>(k * stride + k)] += kRounding * diagonal[k];
  }
  inverse_pivots_.resize(static_cast<std::size_t>(size));
  if (!FactorSmall(size, block_.data(), static_cast<int>(stride), inverse_pivots_.data())) {
    return true;
  }
  for (int k = 0; k < size; ++k) {
    const double inverse = inverse_pivots_[static_cast<std::size_t>(k)];
    if (LandmarkBlocks::kWeakPivot * diagonal[k] * inverse * inverse > 1.0) {
      return true;
    }
  }
  return false;
}

}  // namespace inceres::internal
