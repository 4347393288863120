#pragma once

#include <algorithm>
#include <cstdint>

#include "base/aligned_vector.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// The vectors that go with S, by the quads of the variables: the right-hand side (b of frames, η
/// of landmarks), what a step under trial does to it, and of frames diag(C). Besides, how large b
/// and diag(C) have been since their row was summed, for adding and subtracting leaves ε times
/// that.
class PaddedVectors {
 public:
  /// Room for a variable, whose entries are zero.
  void MakeRoom(std::int32_t quad, int size);
  /// Before a row is summed anew. A change under trial stays.
  void Zero(std::int32_t quad, int size);

  double* rhs() { return rhs_.data(); }
  double* rhs(std::int32_t quad) { return rhs_.data() + First(quad); }
  const double* rhs(std::int32_t quad) const { return rhs_.data() + First(quad); }
  double* change() { return change_.data(); }
  double* diagonal() { return C_diagonal_.data(); }
  const double* diagonal(std::int32_t quad) const { return C_diagonal_.data() + First(quad); }
  /// Kernels that add to b and diag(C) keep these up.
  double* b_peak() { return b_peak_.data(); }
  double* diagonal_peak() { return C_peak_.data(); }

  /// The change under trial is taken over, or forgotten.
  void TakeChange(std::int32_t quad, int size);
  void DropChange(std::int32_t quad, int size) {
    std::fill_n(change_.begin() + First(quad), PadToQuad(size), 0.0);
  }

  /// Whether cancellation has eaten too many digits of the row's entries, of C against C, of b
  /// against √(C · 2 cost); looks at b as it is now, too.
  bool HasDrifted(std::int32_t quad, int size, double cost);

  std::size_t Bytes() const { return sizeof(double) * 5 * rhs_.capacity(); }

 private:
  static std::ptrdiff_t First(std::int32_t quad) { return std::ptrdiff_t{quad} * kQuad; }

  AlignedVector<double> rhs_;
  AlignedVector<double> change_;  // laid out as rhs_, and so the three below
  AlignedVector<double> C_diagonal_;
  AlignedVector<double> C_peak_;
  AlignedVector<double> b_peak_;
};

}  // namespace inceres::internal
