#include "linear/cluster_cholesky.h"

#include <algorithm>
#include <iterator>

#include "linear/pattern_rows.h"
#include "simd/kernels.h"

namespace inceres::internal {

// M for CLUSTER_JACOBI and CLUSTER_TRIDIAGONAL (docs/algorithms.md, "Reduced linear systems",
// clusters; Kushal & Agarwal 2012), and the fine half of the two-level preconditioner: the blocks
// of S within clusters, and with neighbors those between them, in a sparse Cholesky factor. The
// blocks that are kept are a subset of the pattern of S, so the factor reads the values of S where
// they are.
//
// Leaving out blocks of a positive definite matrix between clusters keeps it so as long as whole
// clusters are kept. With paths of clusters this need not hold; half of each block between them is
// then kept, which is positive definite if S is (lemma 1 there).

ClusterCholesky::ClusterCholesky(const BlockPattern& S, const FrameClusters& clusters,
                                 const Executor& executor, Status* status)
    : factor_(executor) {
  // The pattern is copied, since it keeps fewer blocks; offsets of values stay those of S.
  pattern_.offsets = S.offsets;
  pattern_.padded = S.padded;
  pattern_.row_begin.push_back(0);
  padded_.push_back(0);
  for (int i = 0; i < S.num_blocks(); ++i) {
    for (int k = S.row_begin[i]; k < S.row_begin[i + 1]; ++k) {
      if (clusters.Keeps(i, S.columns[k])) {
        is_between_.push_back(clusters.cluster_of[i] != clusters.cluster_of[S.columns[k]] ? 1 : 0);
        pattern_.columns.push_back(S.columns[k]);
        pattern_.value_begin.push_back(S.value_begin[k]);
      }
    }
    pattern_.row_begin.push_back(static_cast<int>(pattern_.columns.size()));
    padded_.push_back(padded_.back() + PadToQuad(S.block_size(i)));
  }
  pattern_.value_begin.push_back(S.value_begin.back());
  // Without blocks between clusters there is nothing to halve, and Factorize has no second try.
  if (clusters.neighbors.empty()) {
    is_between_.clear();
  }
  packed_r_.resize(pattern_.size());
  packed_z_.resize(pattern_.size());
  *status = factor_.Analyze(ReducedMatrix(pattern_, nullptr, nullptr));
}

Status ClusterCholesky::Factorize(const double* values, const double* diagonal) {
  const Status factored = factor_.Factorize(ReducedMatrix(pattern_, values, diagonal), {});
  // The full blocks precondition better, so they are tried first each time.
  if (factored.ok() || is_between_.empty()) {
    return factored;
  }
  Halve(values);
  return factor_.Factorize(ReducedMatrix(own_, halved_.data(), diagonal), {});
}

void ClusterCholesky::Halve(const double* values) {
  // Copies values, as S itself is not to be changed: products with it go on.
  own_ = pattern_;
  own_.value_begin.assign(1, 0);
  halved_.clear();
  ForEachBlock(pattern_, [&](int i, int j, int k) {
    const int rows = pattern_.block_size(i), stride = pattern_.row_stride(j);
    const double* const block = values + pattern_.value_begin[k];
    const double scale = is_between_[k] != 0 ? 0.5 : 1.0;
    std::transform(block, block + static_cast<std::ptrdiff_t>(rows) * stride,
                   std::back_inserter(halved_), [scale](double value) { return scale * value; });
    own_.value_begin.push_back(static_cast<std::int64_t>(halved_.size()));
  });
}

void ClusterCholesky::Apply(const double* r, double* z) {
  // The factor takes packed vectors, conjugate gradients keep padded ones.
  const std::vector<int>& packed = pattern_.offsets;
  for (int i = 0; i < pattern_.num_blocks(); ++i) {
    std::copy_n(r + padded_[i], pattern_.block_size(i), packed_r_.data() + packed[i]);
  }
  // Factorize has succeeded: there is nothing left to fail.
  static_cast<void>(factor_.Solve(packed_r_.data(), {}, {}, packed_z_.data()));
  for (int i = 0; i < pattern_.num_blocks(); ++i) {
    double* const end =
        std::copy_n(packed_z_.data() + packed[i], pattern_.block_size(i), z + padded_[i]);
    std::fill(end, z + padded_[i + 1], 0.0);
  }
}

std::int64_t ClusterCholesky::Bytes() const {
  return static_cast<std::int64_t>(
      factor_.Bytes() + (packed_r_.size() + packed_z_.size() + halved_.size()) * sizeof(double) +
      pattern_.columns.size() * sizeof(int) + pattern_.value_begin.size() * sizeof(std::int64_t));
}

}  // namespace inceres::internal
