#include "schur/live_system.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

namespace inceres::internal {

void LiveSystem::TakeUpVariables() {
  values_.Grow(graph_);
  tangents_.Grow(graph_);
  for (auto id = static_cast<VariableId>(frame_of_.size()); id < graph_.num_variables(); ++id) {
    const bool moves = !graph_.IsConstant(id);
    const bool landmark = graph_.role(id) == Role::kLandmark;
    frame_of_.push_back(moves && !landmark ? schur_.AddFrame(id, tangents_.quad(id), graph_.TangentSize(id)) : -1);
    landmark_of_.push_back(moves && landmark ? schur_.AddLandmark(id, tangents_.quad(id), graph_.TangentSize(id)) : -1);
  }
  dirty_landmarks_.Grow(schur_.landmarks().size());
  stale_landmarks_.Grow(schur_.landmarks().size());
  visited_.Grow(schur_.landmarks().size());
  moved_.Grow(schur_.frames().size());
  step_.resize(static_cast<std::size_t>(tangents_.num_quads()) * kQuad, 0.0);
}

void LiveSystem::TakeUpAdditions() {
  TakeUpVariables();
  for (auto id = static_cast<FamilyId>(families_.size()); id < graph_.num_families(); ++id) {
    families_.emplace_back(graph_, id);
    dirty_.emplace_back();
    touched_.emplace_back();
    linearised_.emplace_back();
  }
  std::vector<std::int32_t> frames;
  for (LiveFamily& family : families_) {
    const int first = family.num_factors();
    family.Grow(&values_, tangents_);
    for (std::vector<IndexSet>* sets : {&dirty_, &touched_, &linearised_}) {
      (*sets)[family.id()].Grow(family.num_factors());
    }
    for (int i = first; i < family.num_factors(); ++i) {
      frames.clear();
      int landmark = -1;
      for (int s = 0; s < family.num_slots(); ++s) {
        const VariableId variable = family.variables(i)[s];
        frames.push_back(frame_of_[variable]);
        landmark = std::max(landmark, landmark_of_[variable]);
      }
      schur_.Connect({family.id(), i}, frames.data(), landmark);
      dirty_[family.id()].Add(i);
    }
  }
}

int LiveSystem::NumDirtyFactors() const {
  std::size_t count = 0;
  for (const IndexSet& dirty : dirty_) {
    count += dirty.indices().size();
  }
  return static_cast<int>(count);
}

void LiveSystem::Redamp(std::int32_t landmark) {
  if (dirty_landmarks_.Add(landmark)) {
    schur_.TakeOut(landmark);
  }
}

Status LiveSystem::Relinearise(double lambda) {
  for (LiveFamily& family : families_) {
    const Status linearised = LineariseFamily(&family);
    if (!linearised.ok()) {
      return linearised;
    }
  }
  for (const std::int32_t landmark : dirty_landmarks_.indices()) {
    schur_.PutIn(landmark, lambda);
  }
  num_eliminated_ += static_cast<int>(dirty_landmarks_.indices().size());
  dirty_landmarks_.Clear();
  return Status::Ok();
}

Status LiveSystem::LineariseFamily(LiveFamily* family) {
  IndexSet& dirty = dirty_[family->id()];
  dirty.Sort();
  for (const std::int32_t i : dirty.indices()) {
    const FactorRef ref{family->id(), i};
    const std::int32_t landmark = schur_.LandmarkOfFactor(ref);
    if (landmark >= 0) {
      Redamp(landmark);
    }
    if (linearised_[family->id()].Has(i)) {
      schur_.AddFactor(ref, -1.0);
      cost_ -= family->Cost(i);
    }
    for (int s = 0; s < family->num_slots(); ++s) {
      const VariableId id = family->variables(i)[s];
      if (!tangents_.Refresh(graph_, values_, id)) {
        return Status::Error(StatusCode::kEvaluationFailed,
                             "the manifold of variable " + std::to_string(id) + " has no Jacobian here");
      }
    }
  }
  const EvaluationFailure failure = family->Linearise(dirty.indices());
  if (failure.failed()) {
    return Status::Error(StatusCode::kEvaluationFailed,
                         graph_.DescribeFactor(family->id(), failure.factor) + ": " + failure.reason);
  }
  for (const std::int32_t i : dirty.indices()) {
    schur_.AddFactor({family->id(), i}, 1.0);
    linearised_[family->id()].Add(i);
    cost_ += family->Cost(i);
  }
  dirty.Clear();
  return Status::Ok();
}

void LiveSystem::SetFrameStep(std::int32_t frame, const double* step) {
  const LiveSchur::Frame& moved = schur_.frames()[frame];
  moved_.Add(frame);
  std::copy_n(step, moved.size, step_.data() + static_cast<std::ptrdiff_t>(moved.quad) * kQuad);
}

void LiveSystem::Visit(std::int32_t landmark) {
  visited_.Add(landmark);
  schur_.BackSubstitute(landmark, step_.data());
}

void LiveSystem::Move(VariableId id, std::int32_t quad, const std::vector<FactorRef>& factors) {
  const double* step = step_.data() + static_cast<std::ptrdiff_t>(quad) * kQuad;
  const double* x = values_.current(id);
  double* moved = values_.candidate(id);
  if (const Manifold* manifold = graph_.manifold(id)) {
    if (!manifold->Plus(x, step, moved)) {
      moved[0] = std::nan("");  // the factors will refuse it
    }
  } else {
    std::transform(x, x + graph_.AmbientSize(id), step, moved, std::plus<>());
  }
  for (const FactorRef& ref : factors) {
    touched_[ref.family].Add(ref.factor);
  }
}

Status LiveSystem::EvaluateStep(double* change, double* predicted_decrease) {
  for (const std::int32_t i : moved_.indices()) {
    const LiveSchur::Frame& frame = schur_.frames()[i];
    Move(frame.id, frame.quad, frame.factors);
  }
  for (const std::int32_t l : visited_.indices()) {
    const LiveSchur::Landmark& landmark = schur_.landmarks()[l];
    Move(landmark.id, landmark.quad, landmark.factors);
  }
  *change = 0.0;
  *predicted_decrease = 0.0;
  for (LiveFamily& family : families_) {
    IndexSet& touched = touched_[family.id()];
    touched.Sort();
    const EvaluationFailure failure = family.EvaluateCandidate(touched.indices());
    if (failure.failed()) {
      return Status::Error(StatusCode::kEvaluationFailed,
                           graph_.DescribeFactor(family.id(), failure.factor) + ": " + failure.reason);
    }
    for (const std::int32_t i : touched.indices()) {
      *change += family.CandidateCost(i) - family.Cost(i);
      *predicted_decrease += family.PredictDecrease(i, step_.data());
    }
  }
  return Status::Ok();
}

void LiveSystem::AcceptValues() {
  std::vector<double> q_change;
  for (LiveFamily& family : families_) {
    q_change.resize(family.residual_size());
    for (const std::int32_t i : touched_[family.id()].indices()) {
      const FactorRef ref{family.id(), i};
      cost_ -= family.Cost(i);
      family.Accept(i, q_change.data());
      cost_ += family.Cost(i);
      schur_.ChangeResidual(ref, q_change.data());
      const std::int32_t landmark = schur_.LandmarkOfFactor(ref);
      if (landmark >= 0) {
        stale_landmarks_.Add(landmark);
      }
    }
  }
  for (const std::int32_t landmark : stale_landmarks_.indices()) {
    schur_.RefreshResidual(landmark);
  }
  stale_landmarks_.Clear();
  const auto accept = [this](VariableId id) {
    values_.Accept(id);
    tangents_.MarkMoved(id);
  };
  for (const std::int32_t i : moved_.indices()) {
    accept(schur_.frames()[i].id);
  }
  for (const std::int32_t l : visited_.indices()) {
    accept(schur_.landmarks()[l].id);
  }
}

void LiveSystem::Reject() {
  for (const std::int32_t i : moved_.indices()) {
    values_.Reject(schur_.frames()[i].id);
  }
  for (const std::int32_t l : visited_.indices()) {
    values_.Reject(schur_.landmarks()[l].id);
  }
  EndStep();
}

void LiveSystem::EndStep() {
  const auto clear = [this](std::int32_t quad, int size) {
    std::fill_n(step_.begin() + std::ptrdiff_t{quad} * kQuad, size, 0.0);
  };
  for (const std::int32_t i : moved_.indices()) {
    clear(schur_.frames()[i].quad, schur_.frames()[i].size);
  }
  for (const std::int32_t l : visited_.indices()) {
    clear(schur_.landmarks()[l].quad, schur_.landmarks()[l].size);
  }
  for (IndexSet& touched : touched_) {
    touched.Clear();
  }
  moved_.Clear();
  visited_.Clear();
}

}  // namespace inceres::internal
