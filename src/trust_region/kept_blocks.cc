#include "trust_region/kept_blocks.h"

#include <algorithm>
#include <memory>
#include <numeric>

#include "base/counting_sort.h"
#include "linear/pattern_rows.h"
#include "schur/visibility_clusters.h"

namespace inceres::internal {

// S is never formed, so what a preconditioner reads of it has a pattern and values here. Block
// Jacobi is the case of clusters of one variable each, but for the inverses, which Ceres takes
// there and which are applied faster.
//
// The model that eliminates large blocks adds to the blocks, one product of H_fe H_ee⁻¹ H_ef after
// the other, and asks beforehand which are kept (Keeps), so that others are not even multiplied.
// Only the lower half is there, rows without padding, each block row-major; vectors of Apply are
// padded, for those of the iteration are.

// Clusters and pattern are found once for a structure. Of clusters the pattern is analyzed as well;
// block Jacobi needs no analysis, and its inverses no memory until there are values.
KeptBlocks::KeptBlocks(const ConjugateGradientsOptions& options, const KeptStructure& structure,
                       const Executor& executor, Status* status)
    : kind_(options.preconditioner), executor_(executor) {
  if (kind_ == PreconditionerKind::kSubset || kind_ == PreconditionerKind::kTwoLevel) {
    *status = Status::Error(StatusCode::kInvalidArgument,
                            "large blocks are eliminated without the preconditioners kSubset and "
                            "kTwoLevel");
    return;
  }
  clusters_ = FindClusters(
      structure, options.visibility_clustering == VisibilityClusteringKind::kSingleLinkage);
  pattern_ = FindPattern(structure);
  values_.resize(static_cast<std::size_t>(pattern_.value_begin.back()));
  zeros_.resize(static_cast<std::size_t>(pattern_.size()));
  if (IsByClusters() && pattern_.num_blocks() > 0) {
    factor_ = std::make_unique<ClusterCholesky>(pattern_, clusters_, executor, status);
  }
}

bool KeptBlocks::IsByClusters() const {
  return kind_ == PreconditionerKind::kClusterJacobi ||
         kind_ == PreconditionerKind::kClusterTridiagonal;
}

// Of block Jacobi one for each variable. An eliminated variable takes the part of a landmark:
// variables are alike that share factors with the same ones of these.
FrameClusters KeptBlocks::FindClusters(const KeptStructure& structure, bool single_linkage) const {
  const auto num_kept = static_cast<int>(structure.offsets.size()) - 1;
  if (IsByClusters() && num_kept > 0) {
    return FindVisibilityClusters({num_kept, structure.seen_begin, structure.seen.data()},
                                  single_linkage, kind_ == PreconditionerKind::kClusterTridiagonal);
  }
  FrameClusters single;
  single.cluster_of.resize(static_cast<std::size_t>(num_kept));
  std::iota(single.cluster_of.begin(), single.cluster_of.end(), 0);
  return single;
}

// The diagonal, and what clusters keep of the blocks of S. A block of S between two kept variables
// is there if they share a factor, or both share one with an eliminated variable. Of these the
// pattern takes those that Keeps allows, for block Jacobi none; visibility is not even looked at
// then. Rows are gathered one by one, each column once. Cost: Σ over eliminated variables of the
// square of what they are seen by.
BlockPattern KeptBlocks::FindPattern(const KeptStructure& structure) const {
  const std::size_t num_kept = structure.offsets.size() - 1;
  // Per kept variable: those that share a factor with it, and the eliminated ones that do.
  std::vector<int> coupled_begin, coupled, seen_by_begin, seen_by;
  CountingSort(
      num_kept,
      [&](const auto& add) {
        for (const auto& [i, j] : structure.between) {
          add(i, j);
        }
      },
      &coupled_begin, &coupled);
  CountingSort(
      num_kept,
      [&](const auto& add) {
        for (std::size_t e = 0; IsByClusters() && e + 1 < structure.seen_begin.size(); ++e) {
          for (int k = structure.seen_begin[e]; k < structure.seen_begin[e + 1]; ++k) {
            add(structure.seen[k], static_cast<int>(e));
          }
        }
      },
      &seen_by_begin, &seen_by);
  RowColumns row(static_cast<int>(num_kept));
  BlockPattern pattern = PatternWithoutBlocks(structure.offsets);
  for (int i = 0; i < static_cast<int>(num_kept); ++i) {
    row.Begin(i);
    const auto add = [&](int j) {
      if (Keeps(i, j)) {
        row.Add(j);
      }
    };
    std::for_each(coupled.begin() + coupled_begin[i], coupled.begin() + coupled_begin[i + 1], add);
    for (int k = seen_by_begin[i]; k < seen_by_begin[i + 1]; ++k) {
      std::for_each(structure.seen.begin() + structure.seen_begin[seen_by[k]],
                    structure.seen.begin() + structure.seen_begin[seen_by[k] + 1], add);
    }
    AppendRow(row.Ascending(), &pattern);
  }
  return pattern;
}

void KeptBlocks::SetZero() {
  std::fill(values_.begin(), values_.end(), 0.0);
}

// The sum is in the order of the calls; a search in the row finds the block.
void KeptBlocks::Add(int i, int j, const Eigen::MatrixXd& block) {
  double* const values = values_.data() + pattern_.value_begin[FindBlock(pattern_, i, j)];
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  Eigen::Map<RowMajor>(values, block.rows(), block.cols()) += block;
}

// Λ_c is in the blocks on the diagonal already. Hence zeros in the place of a diagonal that both
// ways to factor would add. The diagonal block is the last one of its row.
Status KeptBlocks::Factorize() {
  if (factor_ != nullptr) {
    return factor_->Factorize(values_.data(), zeros_.data());
  }
  std::vector<const double*> diagonal;
  diagonal.reserve(static_cast<std::size_t>(pattern_.num_blocks()));
  for (int i = 0; i < pattern_.num_blocks(); ++i) {
    diagonal.push_back(values_.data() + pattern_.value_begin[pattern_.row_begin[i + 1] - 1]);
  }
  return inverses_.Invert(pattern_.offsets, diagonal, zeros_.data(), executor_) < 0
             ? Status::Ok()
             : Status::Error(StatusCode::kSingular,
                             "a block of the preconditioner is not positive definite");
}

void KeptBlocks::Apply(const double* r, double* z) {
  if (factor_ != nullptr) {
    factor_->Apply(r, z);
  } else {
    inverses_.Apply(executor_, r, z);
  }
}

std::int64_t KeptBlocks::Bytes() const {
  return static_cast<std::int64_t>((values_.size() + zeros_.size()) * sizeof(double) +
                                   pattern_.columns.size() * (sizeof(int) + sizeof(std::int64_t))) +
         inverses_.Bytes() + (factor_ != nullptr ? factor_->Bytes() : 0);
}

}  // namespace inceres::internal
