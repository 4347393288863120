#include "incremental/padded_vectors.h"

#include <cmath>

namespace inceres::internal {

// Vectors that are kept by adding and subtracting (docs/algorithms.md, "Incremental Schur
// complement"). What was subtracted leaves ε times the largest value the entry has had, and no
// later change takes that away. So each entry of C and b has its peak since its row was summed;
// where the present value has fallen far below it the row's digits are gone, and it is summed anew
// from the cached Jacobians.

namespace {

// How far a diagonal entry of C may fall below its peak before its row is summed anew. Rounding
// leaves about ε √(peak_i peak_j) in S_ij, which is to stay below 1e-10 √(C_ii C_jj).
constexpr double kDriftRatio = 1e4;

}  // namespace

// The place may have belonged to another variable.
void PaddedVectors::MakeRoom(std::int32_t quad, int size) {
  const std::size_t end = static_cast<std::size_t>(quad) * kQuad + PadToQuad(size);
  if (end > rhs_.size()) {
    for (AlignedVector<double>* padded : {&rhs_, &change_, &C_diagonal_, &C_peak_, &b_peak_}) {
      padded->resize(end, 0.0);
    }
  }
  // A change under trial would be added to the new variable's right-hand side.
  DropChange(quad, size);
  Zero(quad, size);
}

void PaddedVectors::Zero(std::int32_t quad, int size) {
  for (AlignedVector<double>* padded : {&rhs_, &C_diagonal_, &C_peak_, &b_peak_}) {
    double* const entries = padded->data() + First(quad);  // mostly a quad or two
    for (int k = 0; k < size; k += kQuad) {
      std::fill_n(entries + k, kQuad, 0.0);
    }
  }
}

// Accepted: the change becomes part of the right-hand side, and the trial's place is clean again.
void PaddedVectors::TakeChange(std::int32_t quad, int size) {
  double* change = change_.data() + First(quad);
  double* entries = rhs(quad);
  for (int k = 0; k < size; ++k) {
    entries[k] += change[k];
    change[k] = 0.0;
  }
}

// What accepted steps change goes to b directly: its peak may be older than b.
bool PaddedVectors::HasDrifted(std::int32_t quad, int size, double cost) {
  bool drifted = false;
  for (std::ptrdiff_t k = First(quad); k < First(quad) + size; ++k) {
    // Diagonal entries are sums of squares: they cannot cancel but by removal. b has both signs
    // and is small at a minimum by itself, so it is held against what Jᵀf can be at most, ‖J_k‖
    // ‖f‖ = √(C_kk · 2 cost).
    b_peak_[k] = std::max(b_peak_[k], std::fabs(rhs_[k]));
    drifted = drifted || C_peak_[k] > kDriftRatio * C_diagonal_[k] ||
              b_peak_[k] > kDriftRatio * std::sqrt(2.0 * cost * C_diagonal_[k]);
  }
  return drifted;
}

}  // namespace inceres::internal
