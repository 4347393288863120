#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"

namespace inceres::internal {

/// The inverses of the diagonal blocks of a symmetric matrix: the block-Jacobi preconditioner of
/// Ceres's JACOBI and SCHUR_JACOBI. Vectors are padded: each block row starts on a quad.
class BlockInverses {
 public:
  /// Inverts blocks[i] + diag(diagonal), square and row-major, of which the lower triangle counts;
  /// offsets and `diagonal` are packed. Returns a row whose block is not positive definite, the
  /// lowest, or −1.
  int Invert(const std::vector<int>& offsets, const std::vector<const double*>& blocks,
             const double* diagonal, const Executor& executor);

  /// z = M⁻¹ r.
  void Apply(const Executor& executor, const double* r, double* z) const;

  std::int64_t Bytes() const;

 private:
  struct Place {
    int size = 0;
    int padded = 0;          // first scalar of the block row
    std::int64_t begin = 0;  // of the inverse: rows of whole quads
  };
  bool InvertBlock(const Place& place, const double* block, const double* diagonal,
                   std::vector<double>* scratch);

  std::vector<Place> places_;
  AlignedVector<double> minus_inverses_;
};

}  // namespace inceres::internal
