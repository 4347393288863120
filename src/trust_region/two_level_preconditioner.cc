#include "trust_region/two_level_preconditioner.h"

namespace inceres::internal {

TwoLevelPreconditioner::TwoLevelPreconditioner(
    const Evaluator& evaluator, const LandmarkIncidences& incidences, const FramePlans& plans,
    const Hessian& hessian, const Elimination& elimination, const FrameAggregates& aggregates,
    const std::vector<const double*>& blocks, bool forms_S, Status* status)
    : evaluator_(evaluator), elimination_(elimination) {
  const BlockPattern& pattern = plans.pattern;
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    C_diagonal_.push_back(hessian.FrameBlock(pattern.row_begin[i + 1] - 1));
  }
  modes_ = std::make_unique<GaugeModes>(evaluator, aggregates.is_shared, status);
  if (!status->ok()) {
    return;
  }
  columns_ = std::make_unique<ModeColumns>(aggregates, pattern.offsets, modes_->AreEuclidean());
  reach_ = std::make_unique<AggregateReach>(aggregates, columns_->widths(), incidences, pattern);
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

void TwoLevelPreconditioner::ComputeModes() {
  columns_->Write(modes_->Compute() ? &modes_->fit() : nullptr, space_.get());
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
