#include "trust_region/two_level_preconditioner.h"

namespace inceres::internal {

// The two-level preconditioner (docs/algorithms.md, "Reduced linear systems"),
//     M⁻¹ = (I − Q A) D⁻¹ (I − A Q) + Q,   Q = V (VᵀA V)⁻¹ Vᵀ
//
// applied from right to left. This file puts together what others compute: modes, columns of V, A
// V, the coarse factor, and the blocks of aggregates. What is made when: aggregates and the shape
// of A V in the constructor, V at the first damping after a linearization, D, A V and VᵀA V at each
// damping. So a refused step costs no new modes.

TwoLevelPreconditioner::TwoLevelPreconditioner(
    const Evaluator& evaluator, const LandmarkIncidences& incidences, const FramePlans& plans,
    const Hessian& hessian, const Elimination& elimination, const FrameAggregates& aggregates,
    const std::vector<const double*>& blocks, bool forms_S, Status* status)
    : evaluator_(evaluator), elimination_(elimination) {
  const BlockPattern& pattern = plans.pattern;
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    // The block on the diagonal is the last of its row, and C has all of these: never null.
    C_diagonal_.push_back(hessian.FrameBlock(pattern.row_begin[i + 1] - 1));
  }
  modes_ = std::make_unique<GaugeModes>(evaluator, aggregates.is_shared, status);
  if (!status->ok()) {
    return;
  }
  // Widths are settled by connections alone, before any modes are known: if these turn out not to
  // fit, columns of parameters take their place within the same widths.
  columns_ = std::make_unique<ModeColumns>(aggregates, pattern.offsets, modes_->AreEuclidean());
  reach_ = std::make_unique<AggregateReach>(aggregates, columns_->widths(), incidences, pattern);
  space_ =
      std::make_unique<CoarseSpace>(pattern.offsets, reach_->shape, evaluator.executor(), status);
  if (!status->ok()) {
    return;
  }
  fine_ =
      std::make_unique<ClusterCholesky>(pattern, aggregates.clusters, evaluator.executor(), status);
  // Of a formed S its blocks are all of A but the damping; else Y Yᵀ is subtracted from those of C.
  products_ = std::make_unique<ProjectedProducts>(incidences, plans, blocks,
                                                  forms_S ? nullptr : &elimination);
  const Layout& layout = evaluator.layout();
  deflated_.resize(static_cast<std::size_t>(layout.quad_offset[layout.num_frames]) * kQuad);
}

// Orthonormal in the norm of C's diagonal blocks: columns are then of one size, whatever the units
// of a frame's parameters.
void TwoLevelPreconditioner::ComputeModes() {
  columns_->Write(modes_->Compute() ? &modes_->fit() : nullptr, space_.get());
  space_->Orthonormalize(C_diagonal_);
}

Status TwoLevelPreconditioner::Prepare(const double* damping) {
  // Not in Refresh: who is never asked for a step needs no modes.
  if (modes_are_stale_) {
    ComputeModes();
    modes_are_stale_ = false;
  }
  // S has been formed for the same damping of landmarks.
  const Status factored = fine_->Factorize(elimination_.S(), damping);
  if (!factored.ok()) {
    return factored;
  }
  products_->Form(*reach_, damping, evaluator_.executor(), space_.get());
  return space_->Factorize();
}

// Deflate keeps q = (VᵀA V)⁻¹ Vᵀ r, which AddCoarse adds back, less what D⁻¹ has done in the coarse
// space already: (I − Q A) and Q in one.
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
