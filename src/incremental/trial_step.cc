#include "incremental/trial_step.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace inceres::internal {
namespace {

// Landmarks of one pass, at most, whose steps cannot be evaluated: each costs another evaluation.
constexpr int kMostRefusals = 16;

// Why the costs of a family's candidates have no sum.
std::string WithoutSum(const FactorGraph& graph, const IncrementalFamily& family,
                       const std::vector<std::int32_t>& touched) {
  const auto culprit = std::find_if(touched.begin(), touched.end(), [&family](std::int32_t i) {
    return !std::isfinite(family.weighed().CandidateCost(i));
  });
  return culprit == touched.end()
             ? "the sum of all costs is not finite"
             : graph.DescribeFailure(
                   family.id(),
                   {*culprit, "its cost is not finite, or its loss gives it no weight"},
                   family.candidate_parameters(*culprit));
}

}  // namespace

// A step under trial, with all that follows from it, and with nothing changed until it is accepted.
// Candidates have their own values, factors their own residuals and q, and what the step does to
// the right-hand sides is summed beside them:
//
//     predicted = −Σ (Jδ)ᵀ(q + ½ Jδ),   change of b and η = −Σ Jᵀ(q_candidate − q),
//
// over the factors that the step touches, in one pass over their Jacobians. The sets below say who
// moves (active_), what is evaluated (touched_), and whose right-hand side changes (reached_, the
// active landmarks, stale_landmarks_). All of them are walked in ascending order, so that sums do
// not depend on the order in which the step was set.

// step_ never shrinks and is zero where nothing moves: End zeroes just what was set.
void TrialStep::GrowVariables() {
  active_.Grow(variables_.num_quads());
  stale_landmarks_.Grow(schur_.landmarks().size());
  searches_.Grow(schur_.landmarks().size());
  reached_.Grow(schur_.frames().size());
}

void TrialStep::GrowFactors(FamilyId family) {
  if (touched_.size() < families_.size()) {
    touched_.resize(families_.size());
    touched_lists_.resize(families_.size());
  }
  touched_[family].Grow(families_[family].num_places());
}

template <typename Variable>
void TrialStep::CutOff(const Variable& moved) {
  is_cut_off_ |= bounds_.CutOff(moved.id, moved.quad, active_.step(moved.quad));
}

// Frames first: a landmark is substituted back from the steps that are set, as they were cut off.
void TrialStep::SetFrame(std::int32_t frame, const double* step) {
  const IncrementalSchur::Frame& moved = schur_.frames()[frame];
  Begin();
  active_.frames().Add(frame);
  std::copy_n(step, moved.size, active_.step(moved.quad));
  CutOff(moved);
}

void TrialStep::Visit(std::int32_t landmark) {
  Begin();
  if (active_.landmarks().Add(landmark)) {
    schur_.blocks().BackSubstitute(landmark, active_.step().data());
    CutOff(schur_.landmarks()[landmark]);
  }
}

// Between two Updates their fields, lists and blocks leave the cache, and each is behind a pointer
// in the one before: so they are asked for in turns, landmarks ahead of their substitution.
template <typename Work>
void TrialStep::FetchAndDo(const std::vector<std::int32_t>& landmarks, const Work& work) const {
  constexpr std::size_t kPlacesAhead = 12, kListsAhead = 8, kBlocksAhead = 4;
  const LandmarkBlocks& blocks = schur_.blocks();
  const std::size_t count = landmarks.size();
  for (std::size_t k = 0; k < count; ++k) {
    if (k + kPlacesAhead < count) {
      blocks.FetchPlaces(landmarks[k + kPlacesAhead]);
    }
    if (k + kListsAhead < count) {
      blocks.FetchLists(landmarks[k + kListsAhead]);
    }
    if (k + kBlocksAhead < count) {
      blocks.FetchBlocks(landmarks[k + kBlocksAhead]);
    }
    work(landmarks[k]);
  }
}

void TrialStep::Visit(const std::vector<std::int32_t>& landmarks) {
  FetchAndDo(landmarks, [this](std::int32_t l) { Visit(l); });
}

template <typename Variable>
void TrialStep::Move(const Variable& moved) {
  const double* step = active_.step(moved.quad);
  double* candidate = variables_.candidate(moved.id);
  if (!MoveVariable(graph_, moved.id, variables_.current(moved.id), step, candidate)) {
    candidate[0] = std::nan("");  // where ⊞ fails there is none: the factors will refuse it
  }
  bounds_.Land(moved.id, step);
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
void TrialStep::ReachFromFrame(std::int32_t i) {
  const IncrementalSchur::Frame& frame = schur_.frames()[i];
  TouchAndReach(frame.factors);
  // A landmark that stays, although a frame that sees it moves: only the factors between the two
  // are touched, and its η changes.
  for (const std::int32_t l : frame.landmarks) {
    if (!Visited(l)) {
      schur_.structure().ForEachFactorBetween(
          l, i, [this](const FactorRef& ref) { touched_[ref.family].Add(ref.factor); });
      stale_landmarks_.Add(l);
    }
  }
}

// Where there is nobody but frames, and all of them move.
void TrialStep::TouchAll() {
  for (const IncrementalFamily& family : families_) {
    for (std::int32_t i = 0; i < family.num_places(); ++i) {
      if (family.weighed().linearized(i)) {
        touched_[family.id()].Add(i);
      }
    }
  }
  active_.frames().ForEach([this](std::int32_t i) { reached_.Add(i); });
}

void TrialStep::NameTouched() {
  if (touched_named_) {
    return;
  }
  touched_named_ = true;
  const bool all_move = active_.frames().count() == schur_.structure().num_frames() &&
                        schur_.structure().num_landmarks() == 0;
  if (all_move) {
    TouchAll();
  } else {
    active_.frames().ForEach([this](std::int32_t i) { ReachFromFrame(i); });
  }
  // Through z: b follows the landmark's η in all rows of its separator.
  const auto reach_frames = [this](std::int32_t l) {
    if (reached_.count() == schur_.structure().num_frames()) {
      return;  // all there are, as late in an Update
    }
    for (const std::int32_t frame : schur_.landmarks()[l].frames) {
      reached_.Add(frame);
    }
  };
  active_.landmarks().ForEach([&](std::int32_t l) {
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
  active_.ForEach([this](const auto& moved) { Move(moved); });
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
    const double family_change = family.weighed().CandidateChange(touched);
    if (!std::isfinite(family_change)) {
      return Status::Error(StatusCode::kEvaluationFailed, WithoutSum(graph_, family, touched));
    }
    *change += family_change;
    *predicted_decrease += family.TryStep(touched, active_.step().data(), schur_.padded_change());
  }
  return Status::Ok();
}

// Takes back what an earlier try has written of the changes of the right-hand sides.
void TrialStep::DropChanges() {
  reached_.ForEach([this](std::int32_t i) { schur_.DropFrameChange(i); });
  ForEachUpdated([this](std::int32_t l) { schur_.DropLandmarkChange(l); });
}

// For RelinearizationRule::kStepSize.
double TrialStep::Largest(FactorRef ref) const {
  const IncrementalFamily& family = families_[ref.family];
  double largest = 0.0;
  for (int s = 0; s < family.num_slots(); ++s) {
    const VariableId id = family.variables(ref.factor)[s];
    // A variable outside the system has no place.
    for (int k = 0; variables_.quad(id) >= 0 && k < variables_.map(id).tangent_size; ++k) {
      largest = std::max(largest, std::fabs(active_.step(variables_.quad(id))[k]));
    }
  }
  return largest;
}

void TrialStep::Shorten(double scaled_norm) {
  if (!path_.is_prepared()) {
    // A step that Evaluate was not asked of, because it is longer than the radius, has no list.
    NameTouched();
    path_.Prepare(active_, bounds_, touched_lists_, &families_);
  }
  path_.Take(scaled_norm, &active_);
  // δ_gn was cut off at bounds, but a point between two points of the box plus rounding, or a
  // Cauchy point, may leave it. Frames and landmarks are cut off alike, coordinate by coordinate.
  active_.ForEach([this](const auto& moved) { CutOff(moved); });
}

// Frames take over what their own factors say, then landmarks pass theirs on to b by b −= Y (z −
// z_old).
int TrialStep::UpdateRhs() {
  reached_.ForEach([this](std::int32_t i) { schur_.TakeChange(i); });
  for (const IndexSet* updated : {&active_.landmarks(), &stale_landmarks_}) {
    updated->CopyTo(&updated_);
    FetchAndDo(updated_, [this](std::int32_t l) { schur_.RefreshResidual(l); });
  }
  return active_.landmarks().count() + stale_landmarks_.count();
}

// Landmarks that stay have candidates equal to their values.
void TrialStep::MoveValues() {
  active_.ForEach([this](const auto& moved) { variables_.Accept(moved.id); });
  active_.frames().ForEach([this](std::int32_t i) { schur_.changes().TouchValues(i); });
}

// Candidates become equal to the current values again, which evaluations of other steps rely on.
void TrialStep::Reject() {
  DropChanges();
  active_.ForEach([this](const auto& moved) { variables_.Reject(moved.id); });
  End();
}

void TrialStep::End() {
  active_.Clear();
  for (const IncrementalFamily& family : families_) {
    touched_[family.id()].Clear();
    touched_lists_[family.id()].clear();
  }
  stale_landmarks_.Clear();
  reached_.Clear();
  touched_named_ = false;
  path_.Drop();
}

// Given the frames, landmarks are independent of each other (docs/algorithms.md, "Landmark
// refinement"), so each steps and is judged by the change of its own factors' costs. All of them
// are evaluated in one pass, family by family, and those that lose are left out of what is then
// accepted as a step like any other.
//
// The step is t U_invᵀ z. What a landmark's last step has shown of its cost is kept as the stretch
// t of its next one, until its values are set or another landmark takes its number.

// Families in turn; the landmark whose factor could not be evaluated, or -1.
std::int32_t TrialStep::EvaluateLandmarks(int* num_evaluated) {
  // Summed below over the landmark's factors.
  active_.landmarks().ForEach([this](std::int32_t l) { searches_.Begin(l); });
  for (IncrementalFamily& family : families_) {
    std::vector<std::int32_t>& touched = touched_lists_[family.id()];
    // Ascending, as sums want them. No frame moves: all factors of the landmarks, and no others.
    touched_[family.id()].CopyTo(&touched);
    *num_evaluated += static_cast<int>(touched.size());
    const EvaluationFailure failure = family.EvaluateCandidate(touched, executor_);
    if (failure.failed()) {
      return schur_.structure().LandmarkOfFactor({family.id(), failure.factor});
    }
    family.PredictDecrease(touched, active_.step().data());
    for (const std::int32_t i : touched) {
      double slope = 0.0, curvature = 0.0;
      family.weighed().Slope(i, &slope, &curvature);
      // −qᵀJδ is the decrease that the gradient promises along this step.
      searches_.Add(schur_.structure().LandmarkOfFactor({family.id(), i}),
                    family.weighed().CandidateCost(i) - family.weighed().Cost(i), slope);
    }
  }
  return -1;
}

// A landmark whose step cannot be evaluated stays, as if it had not been asked, and the others are
// evaluated without it; its next step is as long as the model says. False if there are more of
// those than are worth it: then nobody knows what the landmarks have left.
bool TrialStep::EvaluateUnrefused(int* num_evaluated) {
  for (int refusals = 0; refusals <= kMostRefusals; ++refusals) {
    const std::int32_t l = EvaluateLandmarks(num_evaluated);
    if (l < 0) {
      return true;
    }
    searches_.Forget(l);
    LeaveOut(l);
  }
  searches_.EndUnknown();
  return false;
}

void TrialStep::LeaveOut(std::int32_t landmark) {
  variables_.Reject(schur_.landmarks()[landmark].id);
  active_.LeaveOut(landmark);
  for (const FactorRef& ref : schur_.landmarks()[landmark].factors) {
    // A factor has at most one landmark that moves, so nobody else needs it.
    touched_[ref.family].Remove(ref.factor);
  }
}

// The embedded point iteration of ICE-BA. With the frames held, landmarks share no factor.
bool TrialStep::TryLandmarks(const std::vector<std::int32_t>& landmarks, int* num_evaluated) {
  *num_evaluated = 0;
  searches_.BeginPass();
  for (const std::int32_t landmark : landmarks) {
    Visit(landmark);
    active_.Stretch(landmark, searches_.stretch(landmark));
    // Longer, it may leave bounds that it was within.
    CutOff(schur_.landmarks()[landmark]);
    Move(schur_.landmarks()[landmark]);
    Touch(schur_.landmarks()[landmark].factors);
  }
  if (!EvaluateUnrefused(num_evaluated)) {
    Reject();
    return false;
  }
  for (const std::int32_t landmark : landmarks) {
    if (Visited(landmark) && !searches_.End(landmark)) {
      LeaveOut(landmark);
    }
  }
  if (active_.landmarks().empty()) {
    End();  // nothing was written to the right-hand sides yet
    return false;
  }
  // The lists again, of those that are left, and the frames whose b follows.
  NameTouched();
  for (IncrementalFamily& family : families_) {
    family.TryStep(touched_lists_[family.id()], active_.step().data(), schur_.padded_change());
  }
  return true;
}

}  // namespace inceres::internal
