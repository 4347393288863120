#include "incremental/trial_step.h"

#include <algorithm>
#include <cmath>

namespace inceres::internal {

// A step under trial, with all that follows from it, and with nothing changed until it is accepted.
// Candidates have their own values, factors their own residuals and q, and what the step does to
// the right-hand sides is summed beside them:
//
//     predicted = −Σ (Jδ)ᵀ(q + ½ Jδ),   change of b and η = −Σ Jᵀ(q_candidate − q),
//
// over the factors that the step touches, in one pass over their Jacobians. The sets below say who
// moves (moved_, visited_), what is evaluated (touched_), and whose right-hand side changes
// (reached_, visited_, stale_landmarks_). All of them are walked in ascending order, so that sums
// do not depend on the order in which the step was set.

// step_ never shrinks and is zero where nothing moves: End zeroes just what was set.
void TrialStep::GrowVariables() {
  stale_landmarks_.Grow(schur_.landmarks().size());
  visited_.Grow(schur_.landmarks().size());
  landmark_steps_.resize(schur_.landmarks().size());
  moved_.Grow(schur_.frames().size());
  reached_.Grow(schur_.frames().size());
  const std::size_t entries = static_cast<std::size_t>(variables_.num_quads()) * kQuad;
  if (entries > step_.size()) {
    step_.resize(entries, 0.0);
  }
}

void TrialStep::GrowFactors(FamilyId family) {
  if (touched_.size() < families_.size()) {
    touched_.resize(families_.size());
    touched_lists_.resize(families_.size());
  }
  touched_[family].Grow(families_[family].num_places());
}

void TrialStep::CutOff(VariableId id, std::int32_t quad) {
  is_cut_off_ |= bounds_.CutOff(id, quad, step_.data() + std::ptrdiff_t{quad} * kQuad);
}

// Frames first: a landmark is substituted back from the steps that are set, as they were cut off.
void TrialStep::SetFrame(std::int32_t frame, const double* step) {
  const IncrementalSchur::Frame& moved = schur_.frames()[frame];
  Begin();
  moved_.Add(frame);
  std::copy_n(step, moved.size, step_.data() + std::ptrdiff_t{moved.quad} * kQuad);
  CutOff(moved.id, moved.quad);
}

void TrialStep::Visit(std::int32_t landmark) {
  Begin();
  if (visited_.Add(landmark)) {
    schur_.blocks().BackSubstitute(landmark, step_.data());
    CutOff(schur_.landmarks()[landmark].id, schur_.landmarks()[landmark].quad);
  }
}

void TrialStep::Move(VariableId id, std::int32_t quad) {
  const double* step = step_.data() + std::ptrdiff_t{quad} * kQuad;
  double* moved = variables_.candidate(id);
  if (!MoveVariable(graph_, id, variables_.current(id), step, moved)) {
    // A manifold whose ⊞ fails leaves no candidate.
    moved[0] = std::nan("");  // the factors will refuse it
  }
  bounds_.Land(id, step);
}

void TrialStep::Touch(const std::vector<FactorRef>& factors) {
  for (const FactorRef& ref : factors) {
    touched_[ref.family].Add(ref.factor);
  }
}

// Of each factor once, though all of its frames may move.
void TrialStep::TouchAndReach(const std::vector<FactorRef>& factors) {
  for (const FactorRef& ref : factors) {
    if (touched_[ref.family].Add(ref.factor)) {
      schur_.structure().ForEachFrameOf(ref, [this](std::int32_t frame) { reached_.Add(frame); });
    }
  }
}

// A frame that moves reaches its factors; with them, through their landmarks, other frames'
// right-hand sides.
void TrialStep::NameTouched() {
  if (touched_named_) {
    return;
  }
  touched_named_ = true;
  moved_.ForEach([this](std::int32_t i) {
    const IncrementalSchur::Frame& frame = schur_.frames()[i];
    TouchAndReach(frame.factors);
    // A landmark that stays, although a frame that sees it moves: only the factors between the two
    // are touched, and its η changes.
    for (const std::int32_t l : frame.landmarks) {
      if (!visited_.Has(l)) {
        schur_.structure().ForEachFactorBetween(
            l, i, [this](const FactorRef& ref) { touched_[ref.family].Add(ref.factor); });
        stale_landmarks_.Add(l);
      }
    }
  });
  // Through z: b follows the landmark's η in all rows of its separator.
  const auto reach_frames = [this](std::int32_t l) {
    if (reached_.count() == schur_.structure().num_frames()) {
      return;  // all there are, as late in an Update
    }
    for (const std::int32_t frame : schur_.landmarks()[l].frames) {
      reached_.Add(frame);
    }
  };
  visited_.ForEach([&](std::int32_t l) {
    Touch(schur_.landmarks()[l].factors);
    reach_frames(l);
  });
  stale_landmarks_.ForEach(reach_frames);
  for (const IncrementalFamily& family : families_) {
    touched_[family.id()].CopyTo(&touched_lists_[family.id()]);
  }
}

// May be called again after Shorten: the lists stay, since the same variables move. The decrease is
// by the linearizations there are, however old.
Status TrialStep::Evaluate(double* change, double* predicted_decrease) {
  NameTouched();
  DropChanges();
  moved_.ForEach([this](std::int32_t i) { Move(schur_.frames()[i].id, schur_.frames()[i].quad); });
  visited_.ForEach(
      [this](std::int32_t l) { Move(schur_.landmarks()[l].id, schur_.landmarks()[l].quad); });
  *change = 0.0;
  *predicted_decrease = 0.0;
  for (IncrementalFamily& family : families_) {
    const std::vector<std::int32_t>& touched = touched_lists_[family.id()];
    const EvaluationFailure failure = family.EvaluateCandidate(touched, executor_);
    if (failure.failed()) {
      return Status::Error(StatusCode::kEvaluationFailed,
                           graph_.DescribeFailure(family.id(), failure,
                                                  family.candidate_parameters(failure.factor)));
    }
    *change += family.CandidateChange(touched);
    *predicted_decrease += family.TryStep(touched, step_.data(), schur_.padded_change());
  }
  return Status::Ok();
}

// Takes back what an earlier try has written of the changes of the right-hand sides.
void TrialStep::DropChanges() {
  reached_.ForEach([this](std::int32_t i) { schur_.DropFrameChange(i); });
  visited_.ForEach([this](std::int32_t l) { schur_.DropLandmarkChange(l); });
  stale_landmarks_.ForEach([this](std::int32_t l) { schur_.DropLandmarkChange(l); });
}

// For RelinearizationRule::kStepSize.
double TrialStep::Largest(FactorRef ref) const {
  const IncrementalFamily& family = families_[ref.family];
  double largest = 0.0;
  for (int s = 0; s < family.num_slots(); ++s) {
    const VariableId id = family.variables(ref.factor)[s];
    // A variable outside the system has no place.
    for (int k = 0; variables_.quad(id) >= 0 && k < variables_.map(id).tangent_size; ++k) {
      largest = std::max(
          largest, std::fabs(step_[static_cast<std::size_t>(variables_.quad(id)) * kQuad + k]));
    }
  }
  return largest;
}

// Frames take over what their own factors say, then landmarks pass theirs on to b by b −= Y (z −
// z_old).
int TrialStep::UpdateRhs() {
  reached_.ForEach([this](std::int32_t i) { schur_.TakeChange(i); });
  visited_.ForEach([this](std::int32_t l) { schur_.RefreshResidual(l); });
  stale_landmarks_.ForEach([this](std::int32_t l) { schur_.RefreshResidual(l); });
  return visited_.count() + stale_landmarks_.count();
}

// Landmarks that stay have candidates equal to their values.
void TrialStep::MoveValues() {
  moved_.ForEach([this](std::int32_t i) { variables_.Accept(schur_.frames()[i].id); });
  visited_.ForEach([this](std::int32_t l) { variables_.Accept(schur_.landmarks()[l].id); });
}

// Candidates become equal to the current values again, which evaluations of other steps rely on.
void TrialStep::Reject() {
  DropChanges();
  moved_.ForEach([this](std::int32_t i) { variables_.Reject(schur_.frames()[i].id); });
  visited_.ForEach([this](std::int32_t l) { variables_.Reject(schur_.landmarks()[l].id); });
  End();
}

void TrialStep::End() {
  // Zeros for the next step, whose factors read step_ for all of their variables.
  const auto clear = [this](std::int32_t quad, int size) {
    std::fill_n(step_.begin() + std::ptrdiff_t{quad} * kQuad, size, 0.0);
  };
  moved_.ForEach([&](std::int32_t i) { clear(schur_.frames()[i].quad, schur_.frames()[i].size); });
  visited_.ForEach(
      [&](std::int32_t l) { clear(schur_.landmarks()[l].quad, schur_.landmarks()[l].size); });
  for (const IncrementalFamily& family : families_) {
    touched_[family.id()].Clear();
    touched_lists_[family.id()].clear();
  }
  moved_.Clear();
  visited_.Clear();
  stale_landmarks_.Clear();
  reached_.Clear();
  touched_named_ = false;
  dogleg_prepared_ = false;
}

}  // namespace inceres::internal
