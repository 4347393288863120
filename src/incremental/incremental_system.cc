#include "incremental/incremental_system.h"

namespace inceres::internal {

// The caches of a living problem, brought up to date (docs/algorithms.md, "Incremental Schur
// complement"; the thesis's algorithms 2 to 4). Edits and steps mark factors and landmarks;
// Relinearize does for all of them what was put off: weights, expansion points, linearizations, S
// and b, the landmarks' elimination, and at last who is held at a bound, which needs b.
//
// The order within it matters. A factor's contribution goes out with the rows that went in, so
// those are kept before its Jacobian is written over. A landmark's contribution has its own Y and z
// and may stay in S until all its factors are new. Constants, drift and the cost are looked at when
// the sums are right again.
//
// The cost is kept by difference as well, and S and b are incomplete after a failure: the caller
// makes a new system then.

// The order is that in which each part finds what it needs: factors leave before their variables,
// all of that before the graph forgets them; variables come before their factors, after the graph
// knows them; new values, pins and bounds last, for what has just come may have them too.
// Everything is checked first, since nothing below can be undone.
Status IncrementalSystem::Apply(const GraphEdit& edit) {
  Status status = ActiveBounds::Check(edit);
  status = status.ok() ? graph_.Check(edit, &removed_) : status;
  if (!status.ok()) {
    return status;
  }
  // The last thing that may fail: a family of the user's may throw.
  graph_.PlaceMeasurements(edit);
  // What LittleHasCome rests on: H has only gained, and the gradient only by the new residuals.
  only_grew_ = only_grew_ && removed_.empty() && edit.removed_variables().empty() &&
               edit.losses().empty() && edit.measurements().empty() && edit.constants().empty() &&
               edit.new_values().empty() && edit.pins().empty() && edit.bounds().empty();
  is_rewritten_ = is_rewritten_ || !removed_.empty() || !edit.measurements().empty() ||
                  !edit.new_values().empty();
  FollowVariablesAndFactors(edit);
  FollowFunctionsAndValues(edit);
  return Status::Ok();
}

void IncrementalSystem::FollowVariablesAndFactors(const GraphEdit& edit) {
  for (const FactorId& id : removed_) {
    members_.RemoveFactor({id.family, id.index});
  }
  for (const VariableId id : edit.removed_variables()) {
    members_.RemoveVariable(id);
  }
  graph_.Commit(edit, removed_);
  for (const GraphEdit::NewVariable& variable : edit.new_variables()) {
    members_.AddVariable(variable.id);
  }
  for (const GraphEdit::NewFactor& factor : edit.new_factors()) {
    members_.AddFactor({factor.id.family, factor.id.index});
  }
}

void IncrementalSystem::FollowFunctionsAndValues(const GraphEdit& edit) {
  for (const auto& [id, loss] : edit.losses()) {
    dirty_.MarkReweighed({id.family, id.index});
  }
  for (const auto& [id, place] : edit.measurements()) {
    dirty_.MarkChanged({id.family, id.index});
  }
  toggled_.clear();
  for (const auto& [id, constant] : edit.constants()) {
    toggled_.push_back(id);
    // A constant may lie outside its bounds; set free, it may not.
    Confine(id);
  }
  members_.FollowConstants(toggled_);
  for (const auto& [id, offset] : edit.new_values()) {
    SetValues(id, edit.values().data() + offset);
  }
  for (const auto& [id, offset] : edit.pins()) {
    members_.FollowPin(id);
  }
  for (const GraphEdit::NewBounds& bounds : edit.bounds()) {
    members_.FollowBounds(bounds.id);
    Confine(bounds.id);
  }
  // Of a frame that is outside the system Membership takes the group over when it enters.
  for (const auto& [id, group] : edit.elimination_groups()) {
    if (FrameOf(id) >= 0) {
      schur_.SetFrameGroup(FrameOf(id), group);
    }
  }
}

// Values outside their bounds go there, but for those of a constant.
void IncrementalSystem::Confine(VariableId id) {
  if (!graph_.IsConstant(id) && bounds_.Confine(id)) {
    MarkMoved(id);
  }
}

void IncrementalSystem::SetValues(VariableId id, const double* values) {
  variables_.Set(id, values);
  if (!graph_.IsConstant(id)) {
    bounds_.Confine(id);
  }
  // Of a constant too: its factors see other values.
  MarkMoved(id);
}

// Nothing that was known of its factors holds from here.
void IncrementalSystem::MarkMoved(VariableId id) {
  if (LandmarkOf(id) >= 0) {
    step_.ForgetLandmark(LandmarkOf(id));
  } else if (FrameOf(id) >= 0) {
    schur_.changes().TouchValues(FrameOf(id));
  }
  graph_.TrackFactors();
  graph_.ForEachFactorOf(id, [this](FactorId factor) {
    dirty_.MarkChanged({factor.family, factor.index});
  });
}

// After the batch solver: no factor's last step has led here, so none is steady.
void IncrementalSystem::TakeValues() {
  ForgetNewFrames();
  only_grew_ = is_rewritten_ = false;
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    // What is borrowed is read where it lies, and may lie where nobody can write.
    if (graph_.HasVariable(id) && graph_.StateOffset(id) >= 0) {
      variables_.Set(id, graph_.Values(id));
      if (FrameOf(id) >= 0) {
        schur_.changes().TouchValues(FrameOf(id));
      }
    }
  }
  for (IncrementalFamily& family : families_) {
    family.UnsettleAll();
  }
}

Status IncrementalSystem::LinearizeDirty(RelinearizeWork* work) {
  *work = RelinearizeWork();
  Reweigh();
  dirty_.Begin(work);
  Status linearized = dirty_.Linearize(/*by_difference=*/true);
  cost_.Resum(families_, num_factors());
  return linearized;
}

Status IncrementalSystem::Relinearize(double lambda, RebuildPolicy policy, RelinearizeWork* work) {
  *work = RelinearizeWork();
  Reweigh();
  dirty_.Begin(work);
  work->rebuilt = policy == RebuildPolicy::kAlways || (policy == RebuildPolicy::kWhenCheaper &&
                                                       work->num_factors > 0 && RebuildIsCheaper());
  if (work->rebuilt) {
    schur_.BeginRebuild();
  }
  Status linearized = dirty_.Linearize(!work->rebuilt);
  if (!linearized.ok()) {
    return linearized;
  }
  if (work->rebuilt) {
    // While S is rebuilt TakeOut only forgets. The others go in with the Y and z they have, these
    // follow with new ones.
    dirty_.TakeOutLandmarks();
    schur_.Rebuild();
  }
  work->num_landmarks = dirty_.Eliminate(lambda);
  cost_.Resum(families_, num_factors());
  // After S and b have changed for the last time; what is summed anew there does not change what
  // they are, but for rounding.
  work->num_drifted_frames = schur_.ResumDrifted(cost());
  // By the b of now, so it comes last.
  HoldAtBounds();
  return Status::Ok();
}

// Of frames; landmarks are looked at when they are eliminated, and when a step has changed what
// they are held by.
void IncrementalSystem::HoldAtBounds() {
  members_.bounded_frames().ForEach([this](std::int32_t row) {
    const IncrementalSchur::Frame& frame = schur_.frames()[row];
    // A constant frame is not held at bounds; it is left out as a whole.
    const bool changed = frame.held ? bounds_.Release(frame.quad, frame.size)
                                    : bounds_.Hold(frame.id, frame.quad, schur_.b(row));
    if (changed) {
      schur_.changes().Touch(row);
    }
  });
}

// Residuals first, for b follows from the products that the trial has left with the factors; then
// the values. Jacobians stay: MarkStale looks at their errors afterwards.
int IncrementalSystem::AcceptValues() {
  for (IncrementalFamily& family : families_) {
    cost_.Add(family.Accept(step_.Touched(family.id())));
  }
  const int num_updated = step_.UpdateRhs();
  step_.MoveValues();
  if (bounds_.any()) {
    // A gradient that has turned at a bound frees a coordinate, or holds one. For a landmark that
    // is part of its U_inv.
    step_.ForEachUpdated([this](std::int32_t l) {
      const IncrementalSchur::Landmark& landmark = schur_.landmarks()[l];
      if (schur_.IsInS(l) && bounds_.IsDue(landmark.id, landmark.quad, schur_.eta(l))) {
        Redamp(l);
      }
    });
  }
  for (const IncrementalFamily& family : families_) {
    dirty_.Recenter(family, step_.Touched(family.id()));
  }
  cost_.Resum(families_, num_factors());
  return num_updated;
}

std::int64_t IncrementalSystem::Bytes() const {
  std::int64_t bytes = schur_.Bytes() + step_.Bytes() + rounding_.Bytes();
  for (const IncrementalFamily& family : families_) {
    bytes += family.Bytes();
  }
  return bytes;
}

}  // namespace inceres::internal
