#include "trust_region/two_level_preconditioner.h"

#include <algorithm>
#include <map>

namespace inceres::internal {

TwoLevelPreconditioner::TwoLevelPreconditioner(
    const Evaluator& evaluator, const LandmarkIncidences& incidences, const FramePlans& plans,
    const Hessian& hessian, const Elimination& elimination, const FrameAggregates& aggregates,
    const std::vector<const double*>& blocks, bool forms_S, Status* status)
    : evaluator_(evaluator), plans_(plans), elimination_(elimination), aggregates_(aggregates) {
  const BlockPattern& pattern = plans.pattern;
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    C_diagonal_.push_back(hessian.FrameBlock(pattern.row_begin[i + 1] - 1));
  }
  modes_ = std::make_unique<GaugeModes>(evaluator, aggregates.is_shared, status);
  if (!status->ok()) {
    return;
  }
  reach_ = std::make_unique<AggregateReach>(aggregates, Widths(), incidences, pattern);
  space_ =
      std::make_unique<CoarseSpace>(pattern.offsets, reach_->shape, evaluator.executor(), status);
  if (!status->ok()) {
    return;
  }
  fine_ =
      std::make_unique<ClusterCholesky>(pattern, aggregates.clusters, evaluator.executor(), status);
  products_ = std::make_unique<ProjectedProducts>(incidences, plans, blocks,
                                                  forms_S ? nullptr : &elimination);
  const Layout& layout = evaluator.layout();
  deflated_.resize(static_cast<std::size_t>(layout.quad_offset[layout.num_frames]) * kQuad);
}

// Without gauge modes frames of the same size share columns: those of another size have others.
std::vector<int> TwoLevelPreconditioner::Widths() {
  const BlockPattern& pattern = plans_.pattern;
  std::vector<int> widths(aggregates_.count, modes_->AreEuclidean() ? GaugeModes::kCount : 0);
  std::vector<std::map<int, int>> column_of_size(aggregates_.count);
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    const int aggregate = aggregates_.clusters.cluster_of[i];
    const int size = pattern.block_size(i);
    constant_column_.push_back(0);
    if (aggregates_.is_shared[i] != 0) {
      widths[aggregate] = size;
    } else if (!modes_->AreEuclidean()) {
      const auto [found, is_new] = column_of_size[aggregate].emplace(size, widths[aggregate]);
      widths[aggregate] += is_new ? size : 0;
      constant_column_[i] = found->second;
    }
  }
  return widths;
}

void TwoLevelPreconditioner::ComputeModes() {
  const bool by_gauge = modes_->Compute();
  for (int i = 0; i < plans_.pattern.num_blocks(); ++i) {
    const int aggregate = aggregates_.clusters.cluster_of[i];
    const int stride = space_->stride(aggregate);
    const int size = plans_.pattern.block_size(i);
    double* const V = space_->V(i);
    if (by_gauge && aggregates_.is_shared[i] == 0) {
      std::copy_n(modes_->Of(i), size * stride, V);
      continue;
    }
    std::fill_n(V, size * stride, 0.0);
    const int width = space_->shape().widths[aggregate];
    for (int k = 0; k < size && constant_column_[i] + k < width; ++k) {
      V[k * stride + constant_column_[i] + k] = 1.0;
    }
  }
  space_->Orthonormalize(C_diagonal_);
}

Status TwoLevelPreconditioner::Prepare(const double* damping) {
  if (modes_are_stale_) {
    ComputeModes();
    modes_are_stale_ = false;
  }
  const Status factored = fine_->Factorize(elimination_.S(), damping);
  if (!factored.ok()) {
    return factored;
  }
  products_->Form(*reach_, damping, evaluator_.executor(), space_.get());
  return space_->Factorize();
}

void TwoLevelPreconditioner::Apply(const double* r, double* z) {
  space_->Deflate(r, deflated_.data());
  fine_->Apply(deflated_.data(), z);
  space_->AddCoarse(z);
}

std::int64_t TwoLevelPreconditioner::Bytes() const {
  return modes_->Bytes() + space_->Bytes() + fine_->Bytes() +
         static_cast<std::int64_t>(deflated_.size() * sizeof(double));
}

}  // namespace inceres::internal
