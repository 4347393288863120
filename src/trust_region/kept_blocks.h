#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "base/executor.h"
#include "inceres/solver/options.h"
#include "inceres/status.h"
#include "linear/aggregation.h"
#include "trust_region/preconditioner.h"

namespace inceres::internal {

/// Which variables LargeBlockSchurModel keeps, and what ties them to each other, by their places
/// among their own kind.
struct KeptStructure {
  std::vector<int> offsets;                  // packed, one more
  std::vector<int> seen_begin;               // per eliminated one, one more
  std::vector<std::int32_t> seen;            // kept ones that share a factor with it, ascending
  std::vector<std::pair<int, int>> between;  // kept ones, i > j, that share a factor
};

/// The blocks of S between kept variables that a preconditioner reads, each summed by whoever knows
/// H, and what they precondition: JACOBI and SCHUR_JACOBI by those on the diagonal, CLUSTER_JACOBI
/// and CLUSTER_TRIDIAGONAL by those within clusters of variables that see the same.
class KeptBlocks {
 public:
  /// Fails for other kinds, which factor a sum or have levels: of H, not of this S.
  KeptBlocks(const ConjugateGradientsOptions& options, const KeptStructure& structure,
             const Executor& executor, Status* status);

  /// None of them: the identity.
  bool IsEmpty() const { return kind_ == PreconditionerKind::kIdentity; }
  /// Blocks are those of S, not of H.
  bool AreOfS() const { return !IsEmpty() && kind_ != PreconditionerKind::kJacobi; }
  /// Blocks beside the diagonal too.
  bool IsByClusters() const;
  bool Keeps(int i, int j) const { return clusters_.Keeps(i, j); }

  void SetZero();
  /// Adds to the block (i, j), i ≥ j, which is kept.
  void Add(int i, int j, const Eigen::MatrixXd& block);
  /// Once all are there.
  Status Factorize() { return preconditioner_->Prepare(zeros_.data()); }
  /// z = M⁻¹ r, padded.
  void Apply(const double* r, double* z) { preconditioner_->Apply(r, z); }
  std::int64_t Bytes() const;

 private:
  FrameClusters FindClusters(const KeptStructure& structure, bool single_linkage) const;
  BlockPattern FindPattern(const KeptStructure& structure) const;

  const PreconditionerKind kind_;
  FrameClusters clusters_;
  BlockPattern pattern_;
  std::vector<double> values_;
  std::vector<double> zeros_;  // in the place of Λ_c, which is in the blocks already
  std::unique_ptr<Preconditioner> preconditioner_;  // null: the identity
};

}  // namespace inceres::internal
