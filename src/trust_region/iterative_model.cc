#include "trust_region/iterative_model.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "schur/visibility_clusters.h"
#include "trust_region/schur_model.h"
#include "trust_region/subset_preconditioner.h"
#include "trust_region/two_level_preconditioner.h"

namespace inceres::internal {

// Steps from (S + Λ_c) δ_c = b by conjugate gradients (docs/algorithms.md, "Reduced linear
// systems"; docs/ceres_contract.md, "Conjugate gradients"). Where there are no landmarks S = H, b =
// η, and the same code is Ceres's CGNR.
//
// Three things depend on the options. How S v is computed: from S where it is formed, else from the
// Jacobians. Which blocks of S are formed: all of them in the former case,
// those that the preconditioner reads in the latter. And what is kept of Y: all of it for clusters
// and for two levels without S, else a chunk at a time.
//
// Vectors of the iteration are padded, each frame on a quad; step, damping and b are packed. The
// padding is zero throughout, so that sums run over it.

namespace {

// Eisenstat and Walker's γ, when their safeguard holds, and what a step is worth at most.
constexpr double kEtaShare = 0.9;
constexpr double kLargeEta = 0.1;
constexpr double kLeastEta = 1e-4;

// Jacobi takes C, and a subset its own factors: neither needs S. A block on the diagonal of S is
// enough for SCHUR_JACOBI.
SchurBlocks BlocksToForm(const ConjugateGradientsOptions& options) {
  if (options.explicit_schur_complement) {
    return SchurBlocks::kAll;
  }
  switch (options.preconditioner) {
    case PreconditionerKind::kIdentity:
    case PreconditionerKind::kJacobi:
    case PreconditionerKind::kSubset:
      return SchurBlocks::kNone;
    case PreconditionerKind::kSchurJacobi:
      return SchurBlocks::kDiagonal;
    case PreconditionerKind::kTwoLevel:
    case PreconditionerKind::kClusterJacobi:
    case PreconditionerKind::kClusterTridiagonal:
      return SchurBlocks::kClustered;
  }
  // Of a number that is none of them.
  return SchurBlocks::kNone;
}

// Null but for the two-level preconditioner, which has nothing to join where no frame moves.
std::unique_ptr<FrameAggregates> AggregatesFor(const ConjugateGradientsOptions& options,
                                               const Evaluator& evaluator,
                                               const LandmarkIncidences& incidences) {
  const bool has_any =
      options.preconditioner == PreconditionerKind::kTwoLevel && evaluator.layout().num_frames > 0;
  return has_any ? std::make_unique<FrameAggregates>(evaluator, incidences,
                                                     options.explicit_schur_complement)
                 : nullptr;
}

// Products take the Jacobians, blocks of S a chunk of Y after the other.
std::int64_t QuadsPerChunk(const ConjugateGradientsOptions& options) {
  // A two-level preconditioner without S reads Y for A V, of all landmarks: one chunk then.
  const bool needs_no_more = options.explicit_schur_complement ||
                             options.preconditioner == PreconditionerKind::kIdentity ||
                             options.preconditioner == PreconditionerKind::kJacobi ||
                             options.preconditioner == PreconditionerKind::kSchurJacobi;
  return needs_no_more ? LandmarkIncidences::kQuadsPerChunk
                       : std::numeric_limits<std::int64_t>::max();
}

}  // namespace

IterativeModel::IterativeModel(const ConjugateGradientsOptions& options, Unfinished unfinished,
                               const Evaluator& evaluator, Status* status)
    : ConjugateGradientsModel(options, evaluator),
      unfinished_(unfinished),
      has_landmarks_(evaluator.layout().num_landmarks() > 0),
      // Others than the elimination read Y where S is not formed, and these do not know of a tail:
      // it is allowed with a formed S only.
      incidences_(evaluator, QuadsPerChunk(options_), is_formed()),
      aggregates_(AggregatesFor(options_, evaluator, incidences_)),
      plans_(evaluator, incidences_, BlocksToForm(options_), FindClusters()),
      hessian_(evaluator, incidences_, plans_),
      elimination_(evaluator, incidences_, plans_, hessian_),
      product_(plans_.pattern) {
  *status = CheckBlockOffsets(evaluator, incidences_);
  for (std::size_t k = 0; k < plans_.block_row.size(); ++k) {
    // Addresses stay for good: S and C are written anew in place.
    const double* S = elimination_.S() + plans_.pattern.value_begin[k];
    blocks_.push_back(is_formed() ? S : hessian_.FrameBlock(static_cast<int>(k)));
  }
  // Rows of zeros behind each frame's own ones, up to a whole quad.
  iteration_.Resize(static_cast<std::size_t>(product_.padded_offsets().back()));
  if (status->ok() && product_.num_rows() > 0) {
    MakePreconditioner(status);
  }
  evaluator.Take(product_.Bytes() + static_cast<std::int64_t>(iteration_.Bytes()) +
                     (preconditioner_ != nullptr ? preconditioner_->Bytes() : 0),
                 "conjugate gradients");
}

// Called among the initializers: after incidences_ and aggregates_, which it reads.
// Before the plans, which form the blocks that clusters keep. Null: there are no clusters.
const FrameClusters* IterativeModel::FindClusters() {
  const PreconditionerKind kind = options_.preconditioner;
  if (kind == PreconditionerKind::kClusterJacobi ||
      kind == PreconditionerKind::kClusterTridiagonal) {
    clusters_ = FindVisibilityClusters(
        {evaluator_.layout().num_frames, incidences_.begin, incidences_.frames.data()},
        options_.visibility_clustering == VisibilityClusteringKind::kSingleLinkage,
        kind == PreconditionerKind::kClusterTridiagonal);
    return &clusters_;
  }
  return aggregates_ != nullptr ? &aggregates_->clusters : nullptr;
}

void IterativeModel::MakePreconditioner(Status* status) {
  const PreconditionerKind kind = options_.preconditioner;
  if (kind == PreconditionerKind::kSubset) {
    preconditioner_ = std::make_unique<SubsetPreconditioner>(evaluator_, *options_.subset, status);
    return;
  }
  // FindClusters has filled this for both kinds of clusters.
  if (!clusters_.cluster_of.empty()) {
    preconditioner_ = std::make_unique<ClusterPreconditioner>(
        plans_.pattern, clusters_, elimination_.S(), evaluator_.executor(), status);
    return;
  }
  if (kind == PreconditionerKind::kTwoLevel) {
    preconditioner_ = std::make_unique<TwoLevelPreconditioner>(evaluator_, incidences_, plans_,
                                                               hessian_, elimination_, *aggregates_,
                                                               blocks_, is_formed(), status);
  } else if (kind != PreconditionerKind::kIdentity) {
    const BlockPattern& pattern = plans_.pattern;
    std::vector<const double*> diagonal_blocks;
    std::int64_t entries = 0;  // of inverses, which are there from the first step on
    for (int i = 0; i < pattern.num_blocks(); ++i) {
      // The last block of a row is the one on the diagonal.
      const int k = pattern.row_begin[i + 1] - 1;
      entries += std::int64_t{pattern.block_size(i)} * PadToQuad(pattern.block_size(i));
      diagonal_blocks.push_back(kind == PreconditionerKind::kSchurJacobi
                                    ? elimination_.S() + pattern.value_begin[k]
                                    : hessian_.FrameBlock(k));
    }
    evaluator_.Take(static_cast<std::int64_t>(sizeof(double)) * entries, "the preconditioner");
    preconditioner_ = std::make_unique<BlockPreconditioner>(
        pattern.offsets, std::move(diagonal_blocks), evaluator_.executor());
  }
}

// The tolerance of a step follows the gradients of its own solve.
void IterativeModel::BeginSolve() {
  eta_ = options_.eta;
  gradient_norm_ = 0.0;
}

// Once a linearization. What depends on the damping waits for Solve: after a refused step C, the
// gradient and η are still good.
void IterativeModel::Refresh() {
  hessian_.Accumulate();
  UpdateEta();
  if (preconditioner_ != nullptr) {
    preconditioner_->Refresh();
  }
  clock_->Charge(&seconds_->hessian);
}

// Eisenstat and Walker's second choice, with its safeguard: what the last tolerance promised of the
// convergence is not undercut at once.
void IterativeModel::UpdateEta() {
  if (!options_.eta_follows_gradient) {
    return;
  }
  // ‖g‖ in the norm of diag(H)⁻¹, which does not depend on the units of the variables. A column of
  // zeros has no share.
  double square = 0.0;
  for (std::size_t k = 0; k < Gradient().size(); ++k) {
    square += Diagonal()[k] > 0.0 ? Gradient()[k] * Gradient()[k] / Diagonal()[k] : 0.0;
  }
  const double norm = std::sqrt(square);
  // The first linearization has nothing to compare with and goes by the options.
  if (gradient_norm_ > 0.0) {
    const double share = norm / gradient_norm_;
    // The safeguard: where γ η² is still large, the next η is not below it, however far ‖g‖ has
    // fallen.
    const double before = kEtaShare * eta_ * eta_;
    const double eta = std::max(kEtaShare * share * share, before > kLargeEta ? before : 0.0);
    // Never looser than what was asked for; the floor gives way to an option that lies below it.
    eta_ = std::clamp(eta, std::min(kLeastEta, options_.eta), options_.eta);
  }
  gradient_norm_ = norm;
}

const char* IterativeModel::SolverName() const {
  const bool two_level = options_.preconditioner == PreconditionerKind::kTwoLevel;
  if (!has_landmarks_) {
    return "conjugate gradients on the normal equations";
  }
  if (is_formed()) {
    return two_level ? "conjugate gradients on the reduced system, formed, two-level"
                     : "conjugate gradients on the reduced system, formed";
  }
  return two_level ? "conjugate gradients on the reduced system, by products, two-level"
                   : "conjugate gradients on the reduced system, by products";
}

// Landmarks out, frames by iteration, landmarks back: a damping's Λ_l goes into U_inv at the
// elimination, and its Λ_c into the preconditioner and each product.
Status IterativeModel::Solve(const double* damping, double* step) {
  const int frame_size = plans_.pattern.size();
  BeginStep(damping);
  Status status = elimination_.Eliminate(damping + frame_size);
  clock_->Charge(&seconds_->elimination);
  if (status.ok() && frame_size > 0) {
    status = preconditioner_ != nullptr ? preconditioner_->Prepare(damping) : Status::Ok();
    status = status.ok() ? SolveReduced(step) : status;
    clock_->Charge(&seconds_->factorization);
  }
  if (!status.ok()) {
    return status;
  }
  // As Ceres's explicit Schur complement: of a step that took too many iterations landmarks are not
  // substituted back. Where it is not Ceres that is followed they always are.
  leaves_landmarks_ = unfinished_ == Unfinished::kAsCeres && is_formed() && !converged_;
  if (leaves_landmarks_) {
    std::fill(step + frame_size, step + Gradient().size(), 0.0);
    return status;
  }
  elimination_.BackSubstitute(step, step + frame_size);
  clock_->Charge(&seconds_->back_substitution);
  return status;
}

// b is copied into padded form, x back out of it. eta_ is that of the linearization: steps tried
// again after a refusal are as exact as the first.
Status IterativeModel::SolveReduced(double* step) {
  const std::vector<int>& packed = product_.packed_offsets();
  const std::vector<int>& padded = product_.padded_offsets();
  for (int i = 0; i < product_.num_rows(); ++i) {
    // Whole quads take part in sums: what lies behind a frame's entries must be zero.
    double* const end = std::copy(elimination_.b() + packed[i], elimination_.b() + packed[i + 1],
                                  iteration_.b() + padded[i]);
    std::fill(end, iteration_.b() + padded[i + 1], 0.0);
  }
  const Status iterated = Iterate();
  for (int i = 0; iterated.ok() && i < product_.num_rows(); ++i) {
    const double* const x = iteration_.x() + padded[i];
    std::copy(x, x + product_.block_size(i), step + packed[i]);
  }
  return iterated;
}

// y −= (S + Λ_c) v. Damping comes first, as in Ceres: with a weak preconditioner iterations may
// hang on how the sum is rounded.
void IterativeModel::SubtractProduct(const double* v, double* y) const {
  if (has_landmarks_ && !is_formed()) {
    product_.SubtractDiagonal(damping_, v, y);
    elimination_.SubtractReduced(v, y);
  } else {
    // Without landmarks S is C.
    product_.Subtract(blocks_, damping_, evaluator_.executor(), v, y);
  }
}

bool IterativeModel::Precondition(const double* r, double* z) {
  if (preconditioner_ != nullptr) {
    preconditioner_->Apply(r, z);
    return true;
  }
  // Ceres's identity is that of the scaled system.
  const std::vector<int>& packed = product_.packed_offsets();
  const std::vector<int>& padded = product_.padded_offsets();
  for (int i = 0; i < product_.num_rows(); ++i) {
    for (int k = 0; k < product_.block_size(i); ++k) {
      // In the unscaled system diag(s)⁻¹ I diag(s)⁻¹ is what Ceres takes for M: z = s² r.
      const double s = scale_[packed[i] + k];
      z[padded[i] + k] = s * s * r[padded[i] + k];
    }
    std::fill(z + padded[i] + product_.block_size(i), z + padded[i + 1], 0.0);
  }
  return true;
}

// Products are those of the blocks of S that are formed; C has the blocks that factors reach.
void IterativeModel::Describe(WorkCounts* work) const {
  work->num_frames = plans_.pattern.num_blocks();
  work->reduced_size = plans_.pattern.size();
  work->num_landmarks = incidences_.num_landmarks();
  work->num_schur_products = plans_.num_schur_products();
  work->bytes += elimination_.Bytes() + product_.Bytes() +
                 (preconditioner_ != nullptr ? preconditioner_->Bytes() : 0) +
                 static_cast<std::int64_t>(iteration_.Bytes());
  DescribeHessian(evaluator_, hessian_, plans_, work);
}

}  // namespace inceres::internal
