// What IncrementalSolver tells between Updates: snapshots, covariances, the pattern of S.

#include "incremental/incremental_solver_impl.h"
#include "linear/elimination_order.h"

namespace inceres {

// What is told here is of the last Update; nothing of it moves a value. Covariances need a factor
// of S, which an Update may not have left: then it is made here, by the same parts that an Update
// uses. Snapshots are the one thing that other threads may read, and go through LatestValue.

namespace {

// The lower triangle without its diagonal, by rows of S; a free row has the id -1.
ReducedStructure PatternOf(const internal::IncrementalSchur& schur) {
  ReducedStructure structure;
  for (int row = 0; row < static_cast<int>(schur.frames().size()); ++row) {
    structure.frames.push_back(schur.frames()[row].id);
    for (const internal::SymmetricBlockRows::Entry& entry : schur.S().row(row)) {
      if (entry.column != row) {
        structure.blocks.push_back({row, entry.column});
      }
    }
  }
  return structure;
}

}  // namespace

void IncrementalSolver::Impl::PublishSnapshot(Termination termination) {
  if (!options_.publish_snapshots) {
    return;
  }
  ValueSnapshot* snapshot = snapshots_.Draft();
  snapshot->number_ = ++num_snapshots_;
  snapshot->cost_ = cost_;
  snapshot->termination_ = termination;
  // The buffer has served before: its memory is used again, and publishing allocates only where the
  // problem has grown.
  snapshot->offsets_.clear();
  snapshot->values_.clear();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    const bool exists = graph.HasVariable(id);
    snapshot->offsets_.push_back(exists ? static_cast<std::ptrdiff_t>(snapshot->values_.size())
                                        : -1);
    if (exists) {
      const double* values = Values(id);
      snapshot->values_.insert(snapshot->values_.end(), values, values + graph.AmbientSize(id));
    }
  }
  snapshots_.Publish();
}

bool IncrementalSolver::Impl::ReadSnapshot(ValueSnapshot* snapshot) {
  return snapshots_.Read([snapshot](const ValueSnapshot& latest) { *snapshot = latest; });
}

// Where the batch solver was the last to move, or no step was asked for since S has other rows.
// kSingular is an answer, of a free gauge, and leaves the system whole; any other failure leaves S
// and b incomplete.
Status IncrementalSolver::Impl::PrepareAnew(bool factorize) {
  Form();
  const Status status = factorize ? minimizer_->FactorizeAnew() : minimizer_->LinearizeAnew();
  if (!status.ok() && status.code != StatusCode::kSingular) {
    Restart();
  }
  live->LetDirtyWait();
  return status;
}

Status IncrementalSolver::Impl::Covariance(const std::vector<VariableId>& ids,
                                           const LiveCovarianceOptions& options,
                                           LiveCovariance* covariance) {
  internal::Clear(covariance);
  // Refusals in the order of their cost: options, a graph that was edited, a missing factor, values
  // at bounds.
  Status status = valid_.ok() ? options.Validate() : valid_;
  if (status.ok() && edited_) {
    status = Status::Error(StatusCode::kInvalidArgument,
                           "there is no factor to take covariances from: the graph was edited "
                           "since the last Update that did not fail, or there was none");
  }
  // The undamped S has a factor of its own.
  const bool damped = options.accuracy != CovarianceAccuracy::kUndamped;
  const bool is_ready =
      live != nullptr && (minimizer_->frame_step().HasFactor() || (!damped && live->IsUpToDate()));
  if (status.ok() && !is_ready) {
    status = PrepareAnew(damped);
  } else if (status.ok() && damped && live->schur().changes().num_unfactored() > 0) {
    // An Update may have ended by what the factor from before told.
    internal::FrameStep& frames = minimizer_->frame_step();
    status = frames.FactorizeWith(frames.factored_mu());
  }
  if (!status.ok()) {
    return status;
  }
  // With a coordinate held, S + μD is that of a smaller problem, with 10¹² S_kk on the diagonal.
  if (live->bounds().num_held() > 0) {
    return Status::Error(StatusCode::kUnavailable,
                         "values are held at their bounds; GraphCovariance, which leaves bounds "
                         "out, has a covariance");
  }
  if (undamped_ == nullptr) {
    undamped_ = std::make_unique<internal::UndampedFactor>(live->executor());
  }
  return internal::ComputeLiveCovariance(
      {graph, *live, minimizer_->frame_step(), undamped_.get(), &weakest_}, ids, options,
      covariance);
}

ReducedStructure IncrementalSolver::Impl::Structure() {
  if (!valid_.ok()) {
    return {};
  }
  Form();
  const internal::IncrementalSchur& schur = live->schur();
  ReducedStructure structure = PatternOf(schur);
  const internal::FrameStep& frames = minimizer_->frame_step();
  if (frames.solver() != nullptr && frames.HasFactor()) {
    for (const int row : internal::EliminationOrderOf(*frames.solver(), schur.S())) {
      structure.elimination_order.push_back(schur.frames()[row].id);
    }
  }
  structure.changed.assign(structure.frames.size(), false);
  for (const std::int32_t row : changed_rows_) {
    // A failed Update may have ended with another system.
    if (row < static_cast<std::int32_t>(structure.changed.size())) {
      structure.changed[row] = true;
    }
  }
  return structure;
}

}  // namespace inceres
