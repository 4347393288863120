#include "trust_region/kept_blocks.h"

#include <algorithm>
#include <memory>
#include <numeric>

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
    : kind_(options.preconditioner) {
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
    preconditioner_ = std::make_unique<ClusterPreconditioner>(pattern_, clusters_, values_.data(),
                                                              executor, status);
  } else if (!IsEmpty()) {
    std::vector<const double*> diagonal;
    diagonal.reserve(static_cast<std::size_t>(pattern_.num_blocks()));
    for (int i = 0; i < pattern_.num_blocks(); ++i) {
      // The last block of a row is the one on the diagonal.
      diagonal.push_back(values_.data() + pattern_.value_begin[pattern_.row_begin[i + 1] - 1]);
    }
    preconditioner_ =
        std::make_unique<BlockPreconditioner>(pattern_.offsets, std::move(diagonal), executor);
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
  const auto num_kept = static_cast<int>(structure.offsets.size()) - 1;
  const std::vector<int>& begin = structure.seen_begin;
  // Per kept variable: those that share a factor with it, and the eliminated ones that do.
  std::vector<std::vector<int>> coupled(num_kept), seen_by(num_kept);
  for (const auto& [i, j] : structure.between) {
    coupled[i].push_back(j);
  }
  for (int e = 0; IsByClusters() && e + 1 < static_cast<int>(begin.size()); ++e) {
    for (int k = begin[e]; k < begin[e + 1]; ++k) {
      seen_by[structure.seen[k]].push_back(e);
    }
  }
  RowColumns row(num_kept);
  BlockPattern pattern = PatternWithoutBlocks(structure.offsets);
  for (int i = 0; i < num_kept; ++i) {
    row.Begin(i);
    const auto add = [&](int j) {
      if (Keeps(i, j)) {
        row.Add(j);
      }
    };
    std::for_each(coupled[i].begin(), coupled[i].end(), add);
    for (const int e : seen_by[i]) {
      std::for_each(structure.seen.begin() + begin[e], structure.seen.begin() + begin[e + 1], add);
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

std::int64_t KeptBlocks::Bytes() const {
  return static_cast<std::int64_t>((values_.size() + zeros_.size()) * sizeof(double) +
                                   pattern_.columns.size() * (sizeof(int) + sizeof(std::int64_t))) +
         (preconditioner_ != nullptr ? preconditioner_->Bytes() : 0);
}

}  // namespace inceres::internal
