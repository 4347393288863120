#include "distributed/distributed_model.h"

#include <limits>

#include "distributed/petsc_objects.h"
#include "trust_region/schur_model.h"

namespace inceres::internal {

// The linear model of the batch loop on several ranks (docs/distributed.md; docs/algorithms.md,
// "Schur complement"). A step is
//
//     here:      P, W, C from the factors here;  U_inv, z, b by elimination of the landmarks here
//     together:  g, diag(H) and b of the frames, summed by their owners;  (S + Λ_c) δ_c = b
//     here:      δ_l = U_invᵀ (z − Yᵀ δ_c)
//
// A landmark with all of its factors is on one rank, so neither elimination nor back-substitution
// sends anything. Only frames are shared: what is summed over ranks goes to the owner (Collect),
// and comes back from it (Spread), so that all ranks with a frame have the same bits of it, and its
// damping, which follows from diag(H), is the same as well.
//
// The order of members is the order of set-up: aggregates say which blocks of S are formed, the
// plans which products, and Hessian, elimination and system work by these.

namespace {

// Whether all blocks of S are computed: to be assembled, or because the caller asks for it.
bool FormsS(const DistributedOptions& options) {
  return options.linear_solver == DistributedLinearSolver::kCholesky ||
         options.solver.conjugate_gradients.explicit_schur_complement;
}

// Blocks of S that somebody reads. Where S stays implicit that is the preconditioner alone: its
// diagonal blocks, or those within aggregates.
SchurBlocks BlocksToForm(const DistributedOptions& options) {
  if (FormsS(options)) {
    return SchurBlocks::kAll;
  }
  switch (options.solver.conjugate_gradients.preconditioner) {
    case PreconditionerKind::kSchurJacobi:
      return SchurBlocks::kDiagonal;
    case PreconditionerKind::kTwoLevel:
      return SchurBlocks::kClustered;
    default:
      return SchurBlocks::kNone;
  }
}

// An option that is left at kTwoLevel has no effect on a factorization.
bool IsTwoLevel(const DistributedOptions& options) {
  return options.linear_solver != DistributedLinearSolver::kCholesky &&
         options.solver.conjugate_gradients.preconditioner == PreconditionerKind::kTwoLevel;
}

// Products take the Jacobians, blocks of S a chunk of Y after the other; A V takes all of Y.
std::int64_t QuadsPerChunk(const DistributedOptions& options) {
  return IsTwoLevel(options) ? std::numeric_limits<std::int64_t>::max()
                             : LandmarkIncidences::kQuadsPerChunk;
}

std::unique_ptr<RankedAggregates> AggregatesFor(const DistributedOptions& options,
                                                const Communicator& ranks,
                                                const SharedFrames& frames,
                                                const Evaluator& evaluator,
                                                const LandmarkIncidences& incidences) {
  if (!IsTwoLevel(options)) {
    return nullptr;
  }
  const LogStage stage("inceres aggregate");
  return std::make_unique<RankedAggregates>(ranks, frames, evaluator, incidences);
}

// Where an option becomes a solver.
std::unique_ptr<DistributedReducedSolver> MakeSolver(const DistributedOptions& options,
                                                     ReducedSystem* system, Status* status) {
  switch (options.linear_solver) {
    case DistributedLinearSolver::kCholesky:
      return MakeCholeskySolver(system);
    case DistributedLinearSolver::kKsp:
      return MakeKspSolver(options.solver.conjugate_gradients, system, status);
    // Resolved before; only kConjugateGradients comes here.
    case DistributedLinearSolver::kAutomatic:
    case DistributedLinearSolver::kConjugateGradients:
      break;
  }
  return MakeMergedGradients(options.solver.conjugate_gradients, system);
}

}  // namespace

// The Status is agreed on, as all that follows is collective: a rank whose blocks are too large for
// their offsets stops all.
DistributedModel::DistributedModel(const DistributedOptions& options, const Communicator& ranks,
                                   const SharedFrames& frames, const Evaluator& evaluator,
                                   Status* status)
    : LinearModel(evaluator),
      ranks_(ranks),
      frames_(frames),
      incidences_(evaluator, QuadsPerChunk(options), FormsS(options)),
      aggregates_(AggregatesFor(options, ranks, frames, evaluator, incidences_)),
      plans_(evaluator, incidences_, BlocksToForm(options),
             aggregates_ != nullptr ? &aggregates_->by_owner : nullptr),
      hessian_(evaluator, incidences_, plans_),
      elimination_(evaluator, incidences_, plans_, hessian_),
      parts_{ranks, frames, evaluator, incidences_, plans_, hessian_, elimination_},
      exchange_(ranks, frames, frames.moving(), FramePlace::kTangent),
      rows_(evaluator),
      system_(parts_, &exchange_) {
  *status = ranks.Agree(CheckBlockOffsets(evaluator, incidences_));
  if (status->ok()) {
    solver_ = MakeSolver(options, &system_, status);
  }
  // Without a frame that moves there is no system, and nothing to precondition.
  if (status->ok() && aggregates_ != nullptr && frames.num_frames() > 0) {
    *status = system_.MakeTwoLevel(*aggregates_);
  }
  owned_.resize(static_cast<std::size_t>(exchange_.owned_size()));
  owned_b_.resize(owned_.size());
  owned_step_.resize(owned_.size());
}

DistributedModel::~DistributedModel() = default;

// Of the frames the sums over all ranks, which then all have; of the landmarks what is here.
void DistributedModel::GatherFrames(const std::vector<double>& own, std::vector<double>* all) {
  *all = own;
  exchange_.Collect(own.data(), owned_.data());
  exchange_.Spread(owned_.data(), all->data());
}

// The Jacobians are new: H, g and diag(H) are formed from them, and what preconditioners keep of V
// becomes stale.
void DistributedModel::Refresh() {
  hessian_.Accumulate();
  GatherFrames(hessian_.gradient(), &gradient_);
  GatherFrames(hessian_.diagonal(), &diagonal_);
  system_.Refresh();
  clock_->Charge(&seconds_->hessian);
}

// J itself is never scaled; the scale is for the preconditioner kIdentity alone.
void DistributedModel::ScaleColumnsBy(const std::vector<double>& scale) {
  system_.SetScale(scale.data());
}

int DistributedModel::num_iterations() const {
  return solver_->num_iterations();
}

// `damping` and `step` are packed as the layout: frames, then landmarks. A landmark without a
// Cholesky factor on any rank makes the step invalid on all, before anything of it is exchanged.
Status DistributedModel::Solve(const double* damping, double* step) {
  const auto frame_size = static_cast<std::ptrdiff_t>(exchange_.here_size());
  Status status;
  {
    const LogStage stage("inceres eliminate");
    status = ranks_.Agree(elimination_.Eliminate(damping + frame_size));
  }
  clock_->Charge(&seconds_->elimination);
  if (!status.ok()) {
    return status;
  }
  // The count is that of all ranks: a rank without frames takes part, with vectors of no entries.
  if (frames_.num_frames() > 0) {
    const LogStage stage("inceres reduced");
    system_.SetDamping(damping);
    // b = c − Y z of each rank is a term of the sum that the owner solves for.
    exchange_.Collect(elimination_.b(), owned_b_.data());
    status = solver_->Solve(owned_b_, &owned_step_);
    if (!status.ok()) {
      return status;
    }
    exchange_.Spread(owned_step_.data(), step);
  }
  clock_->Charge(&seconds_->factorization);
  elimination_.BackSubstitute(step, step + frame_size);
  clock_->Charge(&seconds_->back_substitution);
  return status;
}

// −(Jv)ᵀ(f + ½ Jv) and ‖Jv‖² are sums over factors, and a factor is on one rank. One reduction
// takes both.
RowProducts DistributedModel::MultiplyJacobian(const double* v) {
  const RowProducts own = rows_.Multiply(v);
  double sums[2] = {own.model_decrease, own.squared_norm};
  ranks_.SumAll(2, sums);
  return {sums[0], sums[1]};
}

// Over all variables of all ranks, each counted once: a shared frame by its owner. The sum of a
// rank is in the order of its layout, those of the ranks in their order.
double DistributedModel::Dot(const std::vector<double>& a, const std::vector<double>& b) const {
  const Layout& layout = evaluator_.layout();
  double sum = 0.0;
  for (std::size_t i = 0; i < layout.variables.size(); ++i) {
    // Begins at the end of a variable that another rank counts.
    for (int k = ranks_.CountsElsewhere(i) ? layout.packed_offset[i + 1] : layout.packed_offset[i];
         k < layout.packed_offset[i + 1]; ++k) {
      sum += a[static_cast<std::size_t>(k)] * b[static_cast<std::size_t>(k)];
    }
  }
  return ranks_.Sum(sum);
}

bool DistributedModel::IsFinite(const std::vector<double>& v) const {
  return ranks_.All(LinearModel::IsFinite(v));
}

// Counts are of all ranks; bytes are those of this one.
void DistributedModel::Describe(WorkCounts* work) const {
  work->num_frames = SaturatedCount(static_cast<double>(frames_.num_frames()));
  work->reduced_size =
      SaturatedCount(static_cast<double>(frames_.total_size(FramePlace::kTangent)));
  work->num_landmarks = SaturatedCount(ranks_.Sum(incidences_.num_landmarks()));
  work->num_schur_products =
      static_cast<std::int64_t>(ranks_.Sum(static_cast<double>(plans_.num_schur_products())));
  work->bytes += elimination_.Bytes() + system_.Bytes() + solver_->Bytes();
  DescribeHessian(evaluator_, hessian_, plans_, work);
}

}  // namespace inceres::internal
