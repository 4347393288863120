#include "incremental/membership.h"

#include "base/sort_unique.h"

// Who takes part in a living system (docs/algorithms.md, "Incremental Schur complement"). A factor
// has Jacobians for the variables that have a place when it is connected, and for no others: so
// whoever gets a place later has its factors taken out and connected anew. What only becomes
// constant is masked instead, which costs no evaluation; but for factors that come later and whose
// slot has another tangent, which see a constant without a place.

namespace inceres::internal {

// A constant gets no place in S: a variable that never moves costs nothing there.
void Membership::AddVariable(VariableId id) {
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
void Membership::Enter(VariableId id) {
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
  dirty_.GrowLandmarks();
  step_.GrowVariables();
  if (landmark_of_[id] >= 0) {
    // The number may have belonged to another landmark, whose line search this is none of.
    step_.ForgetLandmark(landmark_of_[id]);
  }
}

// Held flags go while the place is still the variable's.
void Membership::RemoveVariable(VariableId id) {
  if (landmark_of_[id] >= 0 || frame_of_[id] >= 0) {
    bounds_.Release(variables_.quad(id), graph_.TangentSize(id));
  }
  if (landmark_of_[id] >= 0) {
    dirty_.DropLandmark(landmark_of_[id]);
    schur_.RemoveLandmark(landmark_of_[id]);
  } else if (frame_of_[id] >= 0) {
    bounded_frames_.Remove(frame_of_[id]);
    schur_.RemoveFrame(frame_of_[id]);
  }
  frame_of_[id] = landmark_of_[id] = -1;
  variables_.Remove(id);
}

// Families only come: their numbers are those of the graph.
void Membership::AdmitFamilies() {
  for (auto id = static_cast<FamilyId>(families_.size()); id < graph_.num_families(); ++id) {
    families_.emplace_back(graph_, id);
    dirty_.GrowFactors(id);
    step_.GrowFactors(id);
  }
}

void Membership::AddFactor(FactorRef ref) {
  AdmitFamilies();
  ++num_factors_;
  Attach(ref);
}

// Of S, for its factors are about to be others.
void Membership::TakeOut(std::int32_t landmark) {
  dirty_.MarkLandmark(landmark);
  schur_.TakeOut(landmark);
}

// The factor is connected and waits to be linearized; S does not change but for its landmark, which
// leaves it.
void Membership::Attach(FactorRef ref) {
  IncrementalFamily& family = families_[ref.family];
  family.Connect(ref.factor, &variables_);
  dirty_.GrowFactors(ref.family);
  step_.GrowFactors(ref.family);
  slots_.clear();
  int landmark = -1;
  for (int s = 0; s < family.num_slots(); ++s) {
    const VariableId variable = family.variables(ref.factor)[s];
    // Without a Jacobian for it the factor has nothing to put into its row or its block.
    if (!family.HasJacobian(ref.factor, s)) {
      slots_.push_back(-1);
      continue;
    }
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
  dirty_.Mark(ref);
}

void Membership::RemoveFactor(FactorRef ref) {
  Detach(ref);
  // Not in Detach: a factor that is attached again goes on waiting.
  dirty_.StopWaiting(ref);
  --num_factors_;
}

// In reverse: what the factor has put into S and the cost goes out while its rows and Jacobians are
// still known.
void Membership::Detach(FactorRef ref) {
  IncrementalFamily& family = families_[ref.family];
  const std::int32_t landmark = schur_.structure().LandmarkOfFactor(ref);
  if (landmark >= 0) {
    TakeOut(landmark);
  }
  if (family.weighed().linearized(ref.factor)) {
    schur_.AddFactor(ref, -1.0);
    cost_.Add(-family.weighed().Cost(ref.factor));
  }
  schur_.Disconnect(ref);
  // Another factor may come to this place, or the same one with other slots.
  family.Forget(ref.factor);
  dirty_.DropFactor(ref);
}

// Constancy is a mask where there is a place, and then no factor is evaluated. A variable without a
// place gets one now, and its factors a Jacobian for it.
void Membership::FollowConstants(const std::vector<VariableId>& ids) {
  entering_.clear();
  reattached_.clear();
  graph_.TrackFactors();
  for (const VariableId id : ids) {
    const bool constant = graph_.IsConstant(id);
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
void Membership::Hold(VariableId id, bool constant) {
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
  dirty_.MarkLandmark(landmark);
  if (constant) {
    // Bounds of a constant do not count, so nothing is held at them. (Frames: HoldAtBounds.)
    bounds_.Release(variables_.quad(id), graph_.TangentSize(id));
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

void Membership::FollowPin(VariableId id) {
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

// The entering variables get their places in the system, and the factors collected take part with
// theirs as they are now. In order, each once: a factor may have been collected by several of its
// variables.
void Membership::Reattach() {
  const auto before = [](const FactorRef& a, const FactorRef& b) {
    return a.family != b.family ? a.family < b.family : a.factor < b.factor;
  };
  // By family and place, each once: the order of the lists that S is summed from must not depend on
  // that of the edit.
  SortUnique(&reattached_, before);
  SortUnique(&entering_);
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

// Who was held was held by other bounds. A frame's row is read anew by its solver; a landmark is
// eliminated anew, which decides who is held.
void Membership::FollowBounds(VariableId id) {
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
    dirty_.MarkLandmark(landmark);
  }
}

// A frame that came and went, or was made constant since, is none.
void Membership::TakeNewFrames(IndexSet* frames) {
  frames->Grow(schur_.frames().size());
  frames->Clear();
  for (const VariableId id : entered_) {
    if (frame_of_[id] >= 0 && !schur_.frames()[frame_of_[id]].held) {
      frames->Add(frame_of_[id]);
    }
  }
  entered_.clear();
}

}  // namespace inceres::internal
