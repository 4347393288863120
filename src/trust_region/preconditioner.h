#pragma once

#include <cstdint>
#include <vector>

#include "inceres/solver/options.h"
#include "linear/block_inverses.h"
#include "linear/cluster_cholesky.h"
#include "linearize/hessian.h"
#include "schur/elimination.h"

namespace inceres::internal {

/// M of conjugate gradients on S + Λ_c. Vectors are padded: each frame starts on a quad.
class Preconditioner {
 public:
  virtual ~Preconditioner() = default;
  /// C and the Jacobians are new.
  virtual void Refresh() {}
  /// M for Λ_c = diag(damping), packed; S has been formed with the same, as far as it is formed.
  virtual Status Prepare(const double* damping) = 0;
  /// z = M⁻¹ r. Not by two threads at once.
  virtual void Apply(const double* r, double* z) = 0;
  virtual std::int64_t Bytes() const = 0;
};

/// Diagonal blocks: Ceres's JACOBI, of C, and SCHUR_JACOBI, of S.
class BlockPreconditioner final : public Preconditioner {
 public:
  /// `blocks`: per frame. `offsets`: the pattern's.
  BlockPreconditioner(const std::vector<int>& offsets, std::vector<const double*> blocks,
                      const Executor& executor);
  Status Prepare(const double* damping) override;
  void Apply(const double* r, double* z) override { inverses_.Apply(executor_, r, z); }
  std::int64_t Bytes() const override { return inverses_.Bytes(); }

 private:
  const std::vector<int>& offsets_;
  const std::vector<const double*> blocks_;
  const Executor& executor_;
  BlockInverses inverses_;
};

/// Blocks of S within clusters of frames, and between neighboring ones: Ceres's CLUSTER_JACOBI and
/// CLUSTER_TRIDIAGONAL.
class ClusterPreconditioner final : public Preconditioner {
 public:
  /// `elimination`: forms the blocks that the clusters keep, in this pattern.
  ClusterPreconditioner(const BlockPattern& pattern, const FrameClusters& clusters,
                        const Elimination& elimination, const Executor& executor, Status* status)
      : elimination_(elimination), factor_(pattern, clusters, executor, status) {}
  Status Prepare(const double* damping) override {
    return factor_.Factorize(elimination_.S(), damping);
  }
  void Apply(const double* r, double* z) override { factor_.Apply(r, z); }
  std::int64_t Bytes() const override { return factor_.Bytes(); }

 private:
  const Elimination& elimination_;
  ClusterCholesky factor_;
};

}  // namespace inceres::internal
