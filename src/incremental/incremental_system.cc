#include "incremental/incremental_system.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

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

namespace {

// Fall of the cost below its peak at which it is summed anew: rounding of the peak would be a share
// of what is left.
constexpr double kCostDrop = 1e4;

// Operations on numbers of full size that a residual is taken to come of.
constexpr double kOperations = 16.0;

int CountAll(const std::vector<IndexSet>& sets) {
  return std::accumulate(sets.begin(), sets.end(), 0,
                         [](int count, const IndexSet& set) { return count + set.count(); });
}

}  // namespace

int IncrementalSystem::NumDirtyFactors() const {
  return CountAll(dirty_);
}

int IncrementalSystem::NumWaitingFactors() const {
  return CountAll(waiting_);
}

int IncrementalSystem::NumReweighedFactors() const {
  return CountAll(reweighed_);
}

// By difference a dirty factor takes its old one's place, and with it its landmark; anew,
// everything goes in once.
// Both in block products. Adding costs 1 a contribution or block product, replacing replace_cost_
// times that. A landmark's cost is shared out among its factors, so that dirty factors alone have
// to be walked, not landmarks. A landmark that is dirty by itself, to be damped anew, does not
// count.
bool IncrementalSystem::RebuildIsCheaper() const {
  double difference = 0.0;
  // All factors once, and all landmarks that are in S.
  const auto anew = static_cast<double>(num_factors_ + schur_.NumPairs());
  for (const IncrementalFamily& family : families_) {
    dirty_[family.id()].ForEach([&](std::int32_t i) {
      difference += family.linearized(i) ? replace_cost_ : 1.0;
      const std::int32_t landmark = schur_.structure().LandmarkOfFactor({family.id(), i});
      if (landmark >= 0 && schur_.IsInS(landmark)) {
        // Each of its factors asks for a share of what replacing its contribution costs.
        difference += replace_cost_ * static_cast<double>(schur_.blocks().NumPairs(landmark)) /
                      static_cast<double>(schur_.landmarks()[landmark].factors.size());
      }
    });
  }
  return difference > anew;
}

// Before anything is linearized: a factor that moves its expansion point is another function. The
// counter has those of accepted steps since the last call, too.
void IncrementalSystem::RecenterDirty(RelinearizeWork* work) {
  for (const IncrementalFamily& family : families_) {
    dirty_[family.id()].CopyTo(&list_);
    Recenter(family, list_);
  }
  work->num_recentered = std::exchange(num_recentered_, 0);
  work->num_factors = NumDirtyFactors();
}

Status IncrementalSystem::LinearizeFamilies(bool by_difference) {
  for (IncrementalFamily& family : families_) {
    Status linearized = LinearizeFamily(&family, by_difference);
    if (!linearized.ok()) {
      return linearized;
    }
  }
  return Status::Ok();
}

// ½ ηᵀ[(P + μD)⁻¹ − (P + λD)⁻¹]η, summed over landmarks with a pivot that is mostly damping
// (docs/algorithms.md, "Stopping rule", trust rule 4). All or none: the sum is what is compared.
bool IncrementalSystem::RedampHidden(double lambda, double gain) {
  double hidden = 0.0;
  list_.clear();
  schur_.blocks().ForEachHeld([&](std::int32_t landmark) {
    if (schur_.IsInS(landmark) && schur_.blocks().lambda(landmark) > lambda) {
      hidden += schur_.blocks().HiddenGain(landmark, lambda, schur_.eta(landmark),
                                           schur_.HeldAtBounds(schur_.landmarks()[landmark].quad));
      list_.push_back(landmark);
    }
  });
  // Written so that a NaN marks nothing.
  if (!(hidden > gain)) {
    return false;
  }
  for (const std::int32_t landmark : list_) {
    Redamp(landmark);
  }
  return true;
}

Status IncrementalSystem::LinearizeDirty(RelinearizeWork* work) {
  *work = RelinearizeWork();
  Reweigh();
  RecenterDirty(work);
  Status linearized = LinearizeFamilies(true);
  ResumCost();
  return linearized;
}

Status IncrementalSystem::Relinearize(double lambda, RebuildRule rule, RelinearizeWork* work) {
  *work = RelinearizeWork();
  Reweigh();
  RecenterDirty(work);
  work->rebuilt = rule == RebuildRule::kAlways || (rule == RebuildRule::kWhenCheaper &&
                                                   work->num_factors > 0 && RebuildIsCheaper());
  if (work->rebuilt) {
    schur_.BeginRebuild();
  }
  Status linearized = LinearizeFamilies(!work->rebuilt);
  if (!linearized.ok()) {
    return linearized;
  }
  if (work->rebuilt) {
    // While S is rebuilt TakeOut only forgets. The others go in with the Y and z they have, these
    // follow with new ones.
    dirty_landmarks_.ForEach([this](std::int32_t landmark) { schur_.TakeOut(landmark); });
    schur_.Rebuild();
  }
  dirty_landmarks_.ForEach([&](std::int32_t landmark) { schur_.PutIn(landmark, lambda); });
  work->num_landmarks = dirty_landmarks_.count();
  dirty_landmarks_.Clear();
  ResumCost();
  // After S and b have changed for the last time; what is summed anew there does not change what
  // they are, but for rounding.
  work->num_drifted_frames = schur_.ResumDrifted(cost_);
  // By the b of now, so it comes last.
  HoldAtBounds();
  return Status::Ok();
}

// Factors whose variables have new values may move their expansion points, and are other functions
// then.
void IncrementalSystem::Recenter(const IncrementalFamily& family,
                                 const std::vector<std::int32_t>& factors) {
  if (!family.family().Recenters()) {
    return;
  }
  for (const std::int32_t i : factors) {
    // Costs of before and after do not compare, and the factor's last step says nothing of it now.
    if (family.Recenter(i)) {
      ++num_recentered_;
      MarkChanged({family.id(), i});
    }
  }
}

const std::vector<FactorRef>& IncrementalSystem::Reweigh() {
  reweighed_list_.clear();
  for (IncrementalFamily& family : families_) {
    if (!reweighed_[family.id()].empty()) {
      ReweighFamily(&family);
    }
  }
  return reweighed_list_;
}

// One by one: its contribution as it is in S goes out for what the new weight makes of it. A loss
// that gives no weight is left to the linearization, which names the factor.
void IncrementalSystem::ReweighFamily(IncrementalFamily* family) {
  IndexSet& reweighed = reweighed_[family->id()];
  reweighed.CopyTo(&list_);
  reweighed.Clear();
  for (const std::int32_t i : list_) {
    const FactorRef ref{family->id(), i};
    // It is evaluated anyway, and without a second-order term: under another loss its residual has
    // not been seen to be steady.
    if (dirty_[family->id()].Has(i)) {
      family->Unsettle(i);
      continue;
    }
    // The rows as they are in S, before Reweigh writes over J and q.
    const std::ptrdiff_t kept = schur_.KeepFactor(ref);
    const double cost = family->Cost(i);
    if (family->Reweigh(i)) {
      schur_.ReplaceFactor(ref, kept);
      // The change alone: the factor was and stays part of the sum.
      AddToCost(family->Cost(i) - cost);
      const std::int32_t landmark = schur_.structure().LandmarkOfFactor(ref);
      if (landmark >= 0) {
        // P and η are sums over the factor, so the landmark's contribution follows with the next
        // elimination.
        Redamp(landmark);
      }
      reweighed_list_.push_back(ref);
    } else {
      MarkChanged(ref);
    }
    schur_.DropKept();
  }
}

// In three passes over the list: what is known of the old linearizations goes into kept_ and out of
// the cost; the family is evaluated on threads; the new ones take their places in S. An evaluation
// that fails leaves the cost of before.
Status IncrementalSystem::LinearizeFamily(IncrementalFamily* family, bool by_difference) {
  IndexSet& dirty = dirty_[family->id()];
  dirty.CopyTo(&list_);
  kept_.clear();
  const double cost = cost_;
  for (const std::int32_t i : list_) {
    const FactorRef ref{family->id(), i};
    const std::int32_t landmark = schur_.structure().LandmarkOfFactor(ref);
    if (landmark >= 0) {
      Redamp(landmark);
    }
    if (family->linearized(i)) {
      AddToCost(-family->Cost(i));
    }
    if (by_difference) {
      // A new factor has nothing to be replaced and is added.
      kept_.push_back(family->linearized(i) ? schur_.KeepFactor(ref) : -1);
    }
    for (int s = 0; s < family->num_slots(); ++s) {
      const VariableId id = family->variables(i)[s];
      // M = ∂(x ⊞ δ)/∂δ of each variable, at most once a move, before threads read it.
      if (!variables_.RefreshMap(graph_, id)) {
        cost_ = cost;
        return Status::Error(
            StatusCode::kEvaluationFailed,
            "the manifold of variable " + std::to_string(id) + " has no Jacobian here");
      }
    }
  }
  const EvaluationFailure failure = family->Linearize(list_, executor_);
  if (failure.failed()) {
    cost_ = cost;
    return Status::Error(
        StatusCode::kEvaluationFailed,
        graph_.DescribeFailure(family->id(), failure, family->parameters(failure.factor)));
  }
  for (const std::int32_t i : list_) {
    AddToCost(family->Cost(i));
  }
  // A cost that is not finite would spoil every difference from here on.
  if (!std::isfinite(cost_)) {
    cost_ = cost;
    return InfiniteCost(*family);
  }
  for (std::size_t k = 0; k < kept_.size(); ++k) {
    const FactorRef ref{family->id(), list_[k]};
    // kept_ is empty where S is rebuilt: the sum over all factors comes later.
    if (kept_[k] >= 0) {
      schur_.ReplaceFactor(ref, kept_[k]);
    } else {
      schur_.AddFactor(ref, 1.0);
    }
  }
  schur_.DropKept();
  dirty.Clear();
  if (family->id() < static_cast<FamilyId>(waiting_.size())) {
    waiting_[family->id()].Clear();
  }
  return Status::Ok();
}

// What has made the cost infinite or NaN, among the factors that were linearized just now.
Status IncrementalSystem::InfiniteCost(const IncrementalFamily& family) const {
  const auto culprit = std::find_if(list_.begin(), list_.end(), [&family](std::int32_t i) {
    return !std::isfinite(family.Cost(i));
  });
  return Status::Error(StatusCode::kEvaluationFailed,
                       culprit == list_.end() ? "the sum of all costs is not finite"
                                              : graph_.DescribeFactor(family.id(), *culprit) +
                                                    ": its cost is not finite");
}

// A frame that came and went, or was made constant since, is none.
void IncrementalSystem::TakeNewFrames(IndexSet* frames) {
  frames->Grow(schur_.frames().size());
  frames->Clear();
  for (const VariableId id : entered_) {
    if (frame_of_[id] >= 0 && !schur_.frames()[frame_of_[id]].held) {
      frames->Add(frame_of_[id]);
    }
  }
  entered_.clear();
}

// Residuals first, for b follows from the products that the trial has left with the factors; then
// the values. Jacobians stay: MarkStale looks at their errors afterwards.
int IncrementalSystem::AcceptValues() {
  for (IncrementalFamily& family : families_) {
    AddToCost(family.Accept(step_.Touched(family.id())));
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
    Recenter(family, step_.Touched(family.id()));
  }
  ResumCost();
  return num_updated;
}

// F_ε = ½ (16 ε)² Σ_v ‖x_v‖_∞² tr C_vv (docs/algorithms.md, "Stopping rule").
double IncrementalSystem::RoundingOfCost() const {
  const auto share = [this](VariableId id, int size, const auto& diagonal) {
    double trace = 0.0;
    for (int k = 0; k < size; ++k) {
      trace += diagonal(k);
    }
    double largest = 0.0;
    for (int k = 0; k < graph_.AmbientSize(id); ++k) {
      largest = std::max(largest, std::fabs(variables_.current(id)[k]));
    }
    return trace * largest * largest;
  };
  double sum = 0.0;
  for (int i = 0; i < static_cast<int>(schur_.frames().size()); ++i) {
    const IncrementalSchur::Frame& frame = schur_.frames()[i];
    if (frame.id >= 0 && !frame.held) {
      const double* C = schur_.FrameDiagonal(i);
      sum += share(frame.id, frame.size, [C](int k) { return C[k]; });
    }
  }
  // No frame can move, and the landmarks' own factors are all that blurs the cost.
  const bool landmarks_only = sum == 0.0;
  for (int l = 0; landmarks_only && l < static_cast<int>(schur_.landmarks().size()); ++l) {
    const IncrementalSchur::Landmark& landmark = schur_.landmarks()[l];
    if (landmark.id >= 0 && schur_.IsInS(l)) {
      const double* P = schur_.blocks().P(l);
      sum += share(landmark.id, landmark.size, [P](int k) { return P[k * kQuad + k]; });
    }
  }
  const double rounding = kOperations * std::numeric_limits<double>::epsilon();
  return 0.5 * rounding * rounding * sum;
}

// The cost is kept by difference and summed anew after as many changes as there are factors, so
// that rounding does not pile up, and when it has fallen far, for what is left of it would be
// rounding.
void IncrementalSystem::ResumCost() {
  if (cost_changes_ <= num_factors_ && cost_peak_ <= kCostDrop * cost_) {
    return;
  }
  cost_changes_ = 0;
  cost_ = 0.0;
  for (const IncrementalFamily& family : families_) {
    // By family and place: the same order whenever it is summed, so the same bits.
    for (std::int32_t i = 0; i < family.num_places(); ++i) {
      cost_ += family.linearized(i) ? family.Cost(i) : 0.0;
    }
  }
  cost_peak_ = cost_;
}

std::int64_t IncrementalSystem::Bytes() const {
  std::int64_t bytes = schur_.Bytes() + step_.Bytes();
  for (const IncrementalFamily& family : families_) {
    bytes += family.Bytes();
  }
  return bytes;
}

}  // namespace inceres::internal
