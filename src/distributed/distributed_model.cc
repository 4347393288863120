#include "distributed/distributed_model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "distributed/petsc_objects.h"
#include "distributed/reduced_solvers.h"
#include "trust_region/schur_model.h"

namespace inceres::internal {
namespace {

bool FormsS(const DistributedOptions& options) {
  return options.linear_solver == DistributedLinearSolver::kCholesky ||
         options.solver.conjugate_gradients.explicit_schur_complement;
}

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

}  // namespace

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
      exchange_(ranks, frames, frames.moving(), FramePlace::kTangent),
      rows_(evaluator),
      system_(ranks, frames, evaluator, plans_, hessian_, elimination_, &exchange_) {
  *status = ranks.Agree(CheckBlockOffsets(evaluator, incidences_));
  if (status->ok()) {
    solver_ = MakeDistributedSolver(options.linear_solver, options.solver.conjugate_gradients,
                                    &system_, status);
  }
  if (status->ok() && aggregates_ != nullptr && frames.num_frames() > 0) {
    *status = system_.MakeTwoLevel(incidences_, *aggregates_);
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

void DistributedModel::Refresh() {
  hessian_.Accumulate();
  GatherFrames(hessian_.gradient(), &gradient_);
  GatherFrames(hessian_.diagonal(), &diagonal_);
  system_.Refresh();
  clock_->Charge(&seconds_->hessian);
}

void DistributedModel::ScaleColumnsBy(const std::vector<double>& scale) {
  system_.SetScale(scale.data());
}

int DistributedModel::num_iterations() const {
  return solver_->num_iterations();
}

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
  if (frames_.num_frames() > 0) {
    const LogStage stage("inceres reduced");
    system_.SetDamping(damping);
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

RowProducts DistributedModel::MultiplyJacobian(const double* v) {
  const RowProducts own = rows_.Multiply(v);
  double sums[2] = {own.model_decrease, own.squared_norm};
  ranks_.SumAll(2, sums);
  RowProducts all;
  all.model_decrease = sums[0];
  all.squared_norm = sums[1];
  return all;
}

double DistributedModel::Dot(const std::vector<double>& a, const std::vector<double>& b) const {
  const Layout& layout = evaluator_.layout();
  double sum = 0.0;
  for (std::size_t i = 0; i < layout.variables.size(); ++i) {
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

void DistributedModel::Describe(WorkCounts* work) const {
  work->num_frames = static_cast<int>(frames_.num_frames());
  work->reduced_size = static_cast<int>(frames_.total_size(FramePlace::kTangent));
  work->num_landmarks = static_cast<int>(ranks_.Sum(incidences_.num_landmarks()));
  work->num_schur_products =
      static_cast<std::int64_t>(ranks_.Sum(static_cast<double>(plans_.schur.terms.size())));
  work->bytes += static_cast<std::int64_t>(sizeof(double) * hessian_.C().size()) +
                 static_cast<std::int64_t>(sizeof(ProductTerm) * (plans_.hessian.terms.size() +
                                                                  plans_.schur.terms.size()));
  work->bytes += elimination_.Bytes() + system_.Bytes() + solver_->Bytes();
  CountDynamicSizes(evaluator_, work);
}

}  // namespace inceres::internal
