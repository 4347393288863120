// How an IncrementalSystem follows the edits of its graph.

#include <algorithm>

#include "incremental/incremental_system.h"

namespace inceres::internal {

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
  // What LittleHasCome rests on: H has only gained, and the gradient only by the new residuals.
  only_grew_ = only_grew_ && removed_.empty() && edit.removed_variables().empty() &&
               edit.losses().empty() && edit.measurements().empty() && edit.constants().empty() &&
               edit.new_values().empty() && edit.pins().empty() && edit.bounds().empty();
  for (const FactorId& id : removed_) {
    RemoveFactor({id.family, id.index});
  }
  for (const VariableId id : edit.removed_variables()) {
    RemoveVariable(id);
  }
  graph_.Commit(edit, removed_);
  for (const GraphEdit::NewVariable& variable : edit.new_variables()) {
    AddVariable(variable.id);
  }
  for (const GraphEdit::NewFactor& factor : edit.new_factors()) {
    AddFactor({factor.id.family, factor.id.index});
  }
  for (const auto& [id, loss] : edit.losses()) {
    MarkReweighed({id.family, id.index});
  }
  for (const auto& [id, place] : edit.measurements()) {
    MarkChanged({id.family, id.index});
  }
  toggled_.clear();
  for (const auto& [id, constant] : edit.constants()) {
    toggled_.push_back(id);
  }
  UpdateConstants(toggled_);
  for (const auto& [id, offset] : edit.new_values()) {
    SetValues(id, edit.values().data() + offset);
  }
  for (const auto& [id, offset] : edit.pins()) {
    FollowPin(id);
  }
  for (const GraphEdit::NewBounds& bounds : edit.bounds()) {
    FollowBounds(bounds.id);
  }
  // Of a frame that is outside the system Enter takes the group over.
  for (const auto& [id, group] : edit.elimination_groups()) {
    if (frame_of_[id] >= 0) {
      schur_.SetFrameGroup(frame_of_[id], group);
    }
  }
  return Status::Ok();
}

// Who was held was held by other bounds. A frame's row is read anew by its solver; a landmark is
// eliminated anew, which decides who is held.
void IncrementalSystem::FollowBounds(VariableId id) {
  const std::int32_t row = frame_of_[id];
  const std::int32_t landmark = landmark_of_[id];
  if (row >= 0 || landmark >= 0) {
    bounds_.Release(variables_.quad(id), graph_.TangentSize(id));
  }
  if (row >= 0) {
    schur_.changes().Touch(row);
    if (graph_.bounds(id) != nullptr) {
      bounded_frames_.Add(row);
    } else {
      bounded_frames_.Remove(row);
    }
  } else if (landmark >= 0) {
    Redamp(landmark);
  }
  Confine(id);
}

// Values outside their bounds go there, but for those of a constant.
void IncrementalSystem::Confine(VariableId id) {
  if (!graph_.IsConstant(id) && bounds_.Confine(id)) {
    MarkMoved(id);
  }
}

// Of frames; landmarks are looked at when they are eliminated, and when a step has changed what
// they are held by.
void IncrementalSystem::HoldAtBounds() {
  bounded_frames_.ForEach([this](std::int32_t row) {
    const IncrementalSchur::Frame& frame = schur_.frames()[row];
    // A constant frame is not held at bounds; it is left out as a whole.
    const bool changed = frame.held ? bounds_.Release(frame.quad, frame.size)
                                    : bounds_.Hold(frame.id, frame.quad, schur_.b(row));
    if (changed) {
      schur_.changes().Touch(row);
    }
  });
}

// Its factors are linearized at the graph's pin from now on, or no longer.
void IncrementalSystem::FollowPin(VariableId id) {
  entering_.clear();
  reattached_.clear();
  // Its tangent map belongs to the pin.
  variables_.MarkMoved(id);
  graph_.TrackFactors();
  graph_.ForEachFactorOf(id, [this](FactorId factor) {
    reattached_.push_back({factor.family, factor.index});
  });
  Reattach();
}

// A constant gets no place in S: a variable that never moves costs nothing there.
void IncrementalSystem::AddVariable(VariableId id) {
  if (id >= static_cast<VariableId>(frame_of_.size())) {
    frame_of_.resize(id + 1, -1);
    landmark_of_.resize(id + 1, -1);
  }
  variables_.Add(graph_, id);
  if (!graph_.IsConstant(id)) {
    bounds_.Confine(id);  // its factors come later
    Enter(id);
  }
}

// From here on it has a place in the padded vectors, and a row of S or a number among the
// landmarks.
void IncrementalSystem::Enter(VariableId id) {
  variables_.Enter(graph_, id);
  if (graph_.role(id) == Role::kLandmark) {
    landmark_of_[id] = schur_.AddLandmark(id, variables_.quad(id), graph_.TangentSize(id));
  } else {
    frame_of_[id] = schur_.AddFrame(id, variables_.quad(id), graph_.TangentSize(id));
    schur_.SetFrameGroup(frame_of_[id], graph_.elimination_group(id));
    entered_.push_back(id);
    bounded_frames_.Grow(schur_.frames().size());
    if (graph_.bounds(id) != nullptr) {
      bounded_frames_.Add(frame_of_[id]);
    }
  }
  dirty_landmarks_.Grow(schur_.landmarks().size());
  step_.GrowVariables();
  if (landmark_of_[id] >= 0) {
    // The number may have belonged to another landmark, whose line search this is none of.
    step_.ForgetLandmark(landmark_of_[id]);
  }
}

// Held flags go while the place is still the variable's.
void IncrementalSystem::RemoveVariable(VariableId id) {
  if (landmark_of_[id] >= 0 || frame_of_[id] >= 0) {
    bounds_.Release(variables_.quad(id), graph_.TangentSize(id));
  }
  if (landmark_of_[id] >= 0) {
    dirty_landmarks_.Remove(landmark_of_[id]);
    schur_.RemoveLandmark(landmark_of_[id]);
  } else if (frame_of_[id] >= 0) {
    bounded_frames_.Remove(frame_of_[id]);
    schur_.RemoveFrame(frame_of_[id]);
  }
  frame_of_[id] = landmark_of_[id] = -1;
  variables_.Remove(id);
}

// Families only come: their numbers are those of the graph.
void IncrementalSystem::AdmitFamilies() {
  for (auto id = static_cast<FamilyId>(families_.size()); id < graph_.num_families(); ++id) {
    families_.emplace_back(graph_, id);
    dirty_.emplace_back();
    reweighed_.emplace_back();
    step_.GrowFactors(id);
  }
}

void IncrementalSystem::AddFactor(FactorRef ref) {
  AdmitFamilies();
  ++num_factors_;
  Attach(ref);
}

// The factor is connected and waits to be linearized; S does not change but for its landmark, which
// leaves it.
void IncrementalSystem::Attach(FactorRef ref) {
  IncrementalFamily& family = families_[ref.family];
  family.Connect(ref.factor, &variables_);
  dirty_[ref.family].Grow(family.num_places());
  reweighed_[ref.family].Grow(family.num_places());
  step_.GrowFactors(ref.family);
  slots_.clear();
  int landmark = -1;
  for (int s = 0; s < family.num_slots(); ++s) {
    const VariableId variable = family.variables(ref.factor)[s];
    slots_.push_back(frame_of_[variable]);
    // Of two landmarks in a factor one is constant.
    // The free one owns the factor. A constant landmark that never took part has no number at all.
    if (landmark_of_[variable] >= 0 && (landmark < 0 || !graph_.IsConstant(variable))) {
      landmark = landmark_of_[variable];
    }
  }
  // The landmark's Y in S has the separator of before, so it goes out before that changes.
  if (landmark >= 0) {
    TakeOut(landmark);
  }
  schur_.Connect(ref, slots_.data(), landmark);
  dirty_[ref.family].Add(ref.factor);
}

void IncrementalSystem::RemoveFactor(FactorRef ref) {
  Detach(ref);
  --num_factors_;
}

// In reverse: what the factor has put into S and the cost goes out while its rows and Jacobians are
// still known.
void IncrementalSystem::Detach(FactorRef ref) {
  IncrementalFamily& family = families_[ref.family];
  const std::int32_t landmark = schur_.structure().LandmarkOfFactor(ref);
  if (landmark >= 0) {
    TakeOut(landmark);
  }
  if (family.linearized(ref.factor)) {
    schur_.AddFactor(ref, -1.0);
    AddToCost(-family.Cost(ref.factor));
  }
  schur_.Disconnect(ref);
  // Another factor may come to this place, or the same one with other slots.
  family.Forget(ref.factor);
  dirty_[ref.family].Remove(ref.factor);
  reweighed_[ref.family].Remove(ref.factor);
}

// Constancy is a mask where there is a place, and then no factor is evaluated. A variable without a
// place gets one now, and its factors a Jacobian for it.
void IncrementalSystem::UpdateConstants(const std::vector<VariableId>& ids) {
  entering_.clear();
  reattached_.clear();
  graph_.TrackFactors();
  for (const VariableId id : ids) {
    const bool constant = graph_.IsConstant(id);
    // A constant may lie outside its bounds; set free, it may not.
    Confine(id);
    if (frame_of_[id] >= 0 || landmark_of_[id] >= 0) {
      Hold(id, constant);
    } else if (!constant) {
      // Constant since it came: its factors have no Jacobian for it yet.
      entering_.push_back(id);
      graph_.ForEachFactorOf(id, [this](FactorId factor) {
        reattached_.push_back({factor.family, factor.index});
      });
    }
  }
  if (!entering_.empty() || !reattached_.empty()) {
    Reattach();
  }
}

// Of a variable that has its place: a frame's row stays in S, and the solver leaves it out; a
// landmark's contribution leaves S.
void IncrementalSystem::Hold(VariableId id, bool constant) {
  if (frame_of_[id] >= 0) {
    if (schur_.frames()[frame_of_[id]].held != constant) {
      schur_.HoldFrame(frame_of_[id], constant);
    }
    return;
  }
  const std::int32_t landmark = landmark_of_[id];
  if (schur_.landmarks()[landmark].held == constant) {
    return;
  }
  schur_.HoldLandmark(landmark, constant);
  // Set free, it is put in by the next Relinearize; held, it is only found to be outside.
  dirty_landmarks_.Add(landmark);
  if (constant) {
    return;
  }
  // A factor of two landmarks, one of them always constant, belongs to the free one.
  graph_.ForEachFactorOf(id, [this, landmark](FactorId factor) {
    const FactorRef ref{factor.family, factor.index};
    if (schur_.structure().LandmarkOfFactor(ref) != landmark) {
      reattached_.push_back(ref);
    }
  });
}

// The entering variables get their places in the system, and the factors collected take part with
// theirs as they are now.
void IncrementalSystem::Reattach() {
  const auto before = [](const FactorRef& a, const FactorRef& b) {
    return a.family != b.family ? a.family < b.family : a.factor < b.factor;
  };
  // By family and place, each once: the order of the lists that S is summed from must not depend on
  // that of the edit.
  std::sort(reattached_.begin(), reattached_.end(), before);
  reattached_.erase(std::unique(reattached_.begin(), reattached_.end()), reattached_.end());
  std::sort(entering_.begin(), entering_.end());
  entering_.erase(std::unique(entering_.begin(), entering_.end()), entering_.end());
  // Detached with their old slots, attached with the new ones: a factor of two variables that enter
  // is connected once.
  for (const FactorRef& ref : reattached_) {
    Detach(ref);
  }
  for (const VariableId id : entering_) {
    Enter(id);
  }
  for (const FactorRef& ref : reattached_) {
    Attach(ref);
  }
}

// After the batch solver: no factor's last step has led here, so none is steady.
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
  if (landmark_of_[id] >= 0) {
    step_.ForgetLandmark(landmark_of_[id]);
  }
  graph_.TrackFactors();
  graph_.ForEachFactorOf(id, [this](FactorId factor) {
    MarkChanged({factor.family, factor.index});
  });
}

}  // namespace inceres::internal
