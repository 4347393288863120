#pragma once

#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "linear/aggregation.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

/// The Cholesky factor of those blocks of S + diag that lie within clusters of frames, or between
/// neighboring ones: block-Jacobi by clusters. Vectors are padded: each block row starts on a quad.
/// Source: Kushal & Agarwal, "Visibility based preconditioning for bundle adjustment", CVPR 2012.
class ClusterCholesky {
 public:
  /// Reads the pattern of S here only; fails if the analysis does.
  ClusterCholesky(const BlockPattern& S, const FrameClusters& clusters, const Executor& executor,
                  Status* status);

  /// `values`: of S; `diagonal`: packed. With neighboring clusters what is kept may not be positive
  /// definite: then blocks between clusters count half, which is (Kushal & Agarwal, lemma 1).
  /// kSingular names a frame.
  Status Factorize(const double* values, const double* diagonal);
  /// z = M⁻¹ r.
  void Apply(const double* r, double* z);
  std::int64_t Bytes() const;

 private:
  void Halve(const double* values);

  BlockPattern pattern_;  // its values are those of S
  // the same with values of its own, and which of its blocks lie between clusters; empty without
  // neighbors
  BlockPattern own_;
  std::vector<char> is_between_;
  std::vector<double> halved_;
  std::vector<int> padded_;
  SparseCholesky factor_;
  std::vector<double> packed_r_;
  std::vector<double> packed_z_;
};

}  // namespace inceres::internal
