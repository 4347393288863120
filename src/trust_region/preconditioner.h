#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "inceres/solver/options.h"
#include "linear/block_inverses.h"
#include "linear/cluster_cholesky.h"

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

/// Diagonal blocks: Ceres's JACOBI, of C, and SCHUR_JACOBI, of S. They are read where C or S has
/// them; their inverses are made for each damping, since Λ_c is added before.
class BlockPreconditioner final : public Preconditioner {
 public:
  /// `blocks`: per frame. `offsets`: the pattern's.
  BlockPreconditioner(const std::vector<int>& offsets, std::vector<const double*> blocks,
                      const Executor& executor)
      : offsets_(offsets), blocks_(std::move(blocks)), executor_(executor) {}
  /// A block without a factor is an invalid step, named by its number in the pattern.
  Status Prepare(const double* damping) override {
    const int singular = inverses_.Invert(offsets_, blocks_, damping, executor_);
    return singular < 0 ? Status::Ok()
                        : Status::Error(StatusCode::kSingular,
                                        "the preconditioner is not positive definite at frame " +
                                            std::to_string(singular));
  }
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
  /// `S`: where the blocks that the clusters keep are written, in this pattern.
  ClusterPreconditioner(const BlockPattern& pattern, const FrameClusters& clusters, const double* S,
                        const Executor& executor, Status* status)
      : S_(S), factor_(pattern, clusters, executor, status) {}
  Status Prepare(const double* damping) override { return factor_.Factorize(S_, damping); }
  void Apply(const double* r, double* z) override { factor_.Apply(r, z); }
  std::int64_t Bytes() const override { return factor_.Bytes(); }

 private:
  const double* S_;
  ClusterCholesky factor_;
};

}  // namespace inceres::internal
