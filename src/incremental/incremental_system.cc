#include "incremental/incremental_system.h"

// A living problem as a whole: an edit is followed by members, marks and values in one order, an
// accepted step by residuals, b and values, and S and b are made current in Relinearize
// (docs/algorithms.md, "Incremental Schur complement"; the thesis's algorithms 2 to 4).

namespace inceres::internal {

// Nothing changes before all of the edit was checked.
Status IncrementalSystem::Apply(const GraphEdit& edit) {
  Status status = ActiveBounds::Check(edit);
  status = status.ok() ? graph_.Check(edit, &removed_) : status;
  if (!status.ok()) {
    return status;
  }
  only_grew_ = only_grew_ && removed_.empty() && edit.removed_variables().empty() &&
               edit.losses().empty() && edit.measurements().empty() && edit.constants().empty() &&
               edit.new_values().empty() && edit.pins().empty() && edit.bounds().empty();
  FollowVariablesAndFactors(edit);
  FollowFunctionsAndValues(edit);
  return Status::Ok();
}

// What goes is taken out while the graph still knows it, and what comes after it does.
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
  MarkMoved(id);
}

// Nothing that was known of its factors holds from here.
void IncrementalSystem::MarkMoved(VariableId id) {
  if (LandmarkOf(id) >= 0) {
    step_.ForgetLandmark(LandmarkOf(id));
  }
  graph_.TrackFactors();
  graph_.ForEachFactorOf(id, [this](FactorId factor) {
    dirty_.MarkChanged({factor.family, factor.index});
  });
}

void IncrementalSystem::TakeValues() {
  ForgetNewFrames();
  only_grew_ = false;
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    // What is borrowed is read where it lies, and may lie where nobody can write.
    if (graph_.HasVariable(id) && graph_.StateOffset(id) >= 0) {
      variables_.Set(id, graph_.Values(id));
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

Status IncrementalSystem::Relinearize(double lambda, RebuildRule rule, RelinearizeWork* work) {
  *work = RelinearizeWork();
  Reweigh();
  dirty_.Begin(work);
  work->rebuilt = rule == RebuildRule::kAlways || (rule == RebuildRule::kWhenCheaper &&
                                                   work->num_factors > 0 && RebuildIsCheaper());
  if (work->rebuilt) {
    schur_.BeginRebuild();
  }
  Status linearized = dirty_.Linearize(!work->rebuilt);
  if (!linearized.ok()) {
    return linearized;
  }
  // Landmarks to be eliminated anyway are not summed with the Y and z they had.
  if (work->rebuilt) {
    dirty_.TakeOutLandmarks();
    schur_.Rebuild();
  }
  work->num_landmarks = dirty_.Eliminate(lambda);
  cost_.Resum(families_, num_factors());
  work->num_drifted_frames = schur_.ResumDrifted(cost());
  HoldAtBounds();
  return Status::Ok();
}

// Of frames; landmarks are looked at when they are eliminated, and when a step has changed what
// they are held by.
void IncrementalSystem::HoldAtBounds() {
  members_.bounded_frames().ForEach([this](std::int32_t row) {
    const IncrementalSchur::Frame& frame = schur_.frames()[row];
    const bool changed = frame.held ? bounds_.Release(frame.quad, frame.size)
                                    : bounds_.Hold(frame.id, frame.quad, schur_.b(row));
    if (changed) {
      schur_.changes().Touch(row);
    }
  });
}

// The values last: the touched factors' shares of b follow from residuals at the candidate, which
// is still beside the values.
int IncrementalSystem::AcceptValues() {
  for (IncrementalFamily& family : families_) {
    cost_.Add(family.Accept(step_.Touched(family.id())));
  }
  const int num_updated = step_.UpdateRhs();
  step_.MoveValues();
  if (bounds_.any()) {
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
  std::int64_t bytes = schur_.Bytes() + step_.Bytes();
  for (const IncrementalFamily& family : families_) {
    bytes += family.Bytes();
  }
  return bytes;
}

}  // namespace inceres::internal
