#include "incremental/dirty_subgraph.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

// What is dirty is linearized and eliminated anew (docs/algorithms.md, "Incremental Schur
// complement"; the thesis's algorithm 3). A factor's old contribution is kept while its Jacobians
// are written over, so that difference and sum go over a block of S once.

namespace inceres::internal {

void DirtySubgraph::GrowFactors(FamilyId family) {
  if (factors_.size() < families_.size()) {
    factors_.resize(families_.size());
    waiting_.resize(families_.size());
    reweighed_.resize(families_.size());
  }
  factors_[family].Grow(families_[family].num_places());
  waiting_[family].Grow(families_[family].num_places());
  reweighed_[family].Grow(families_[family].num_places());
}

int DirtySubgraph::Count(const std::vector<IndexSet>& sets) {
  int count = 0;
  for (const IndexSet& set : sets) {
    count += set.count();
  }
  return count;
}

// By difference a dirty factor takes its old one's place, and with it its landmark; anew,
// everything goes in once.
// Both in block products. Adding costs 1 a contribution or block product, replacing replace_cost_
// times that. A landmark's cost is shared out among its factors, so that dirty factors alone have
// to be walked, not landmarks. A landmark that is dirty by itself, to be damped anew, does not
// count.
bool DirtySubgraph::RebuildIsCheaper(int num_factors) const {
  double difference = 0.0;
  // All factors once, and all landmarks that are in S.
  const auto anew = static_cast<double>(num_factors + schur_.NumPairs());
  for (const IncrementalFamily& family : families_) {
    factors_[family.id()].ForEach([&](std::int32_t i) {
      difference += family.weighed().linearized(i) ? replace_cost_ : 1.0;
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

// ½ ηᵀ[(P + μD)⁻¹ − (P + λD)⁻¹]η, summed over landmarks with a pivot that is mostly damping
// (docs/algorithms.md, "Stopping rule", trust rule 4). All or none: the sum is what is compared.
bool DirtySubgraph::MarkHidden(double lambda, double gain) {
  double hidden = 0.0;
  list_.clear();
  schur_.blocks().ForEachHeld([&](std::int32_t landmark) {
    if (schur_.IsInS(landmark) && schur_.blocks().lambda(landmark) > lambda) {
      hidden += schur_.blocks().HiddenGain(landmark, lambda, schur_.eta(landmark),
                                           schur_.HeldAtBounds(schur_.landmarks()[landmark].quad));
      list_.push_back(landmark);
    }
  });
  // Written so that NaN marks none.
  if (!(hidden > gain)) {
    return false;
  }
  for (const std::int32_t landmark : list_) {
    MarkLandmark(landmark);
  }
  return true;
}

bool DirtySubgraph::MarkDampedMore(double lambda) {
  bool any = false;
  for (std::int32_t l = 0; l < static_cast<std::int32_t>(schur_.landmarks().size()); ++l) {
    if (schur_.IsInS(l) && schur_.blocks().lambda(l) > lambda) {
      MarkLandmark(l);
      any = true;
    }
  }
  return any;
}

void DirtySubgraph::Recenter(const IncrementalFamily& family,
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

// Before anything is linearized: a factor that moves its expansion point is another function. The
// counter has those of accepted steps since the last call, too.
void DirtySubgraph::Begin(RelinearizeWork* work) {
  for (const IncrementalFamily& family : families_) {
    factors_[family.id()].CopyTo(&list_);
    Recenter(family, list_);
  }
  work->num_recentered = std::exchange(num_recentered_, 0);
  work->num_factors = NumFactors();
}

const std::vector<FactorRef>& DirtySubgraph::Reweigh() {
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
void DirtySubgraph::ReweighFamily(IncrementalFamily* family) {
  IndexSet& reweighed = reweighed_[family->id()];
  reweighed.CopyTo(&list_);
  reweighed.Clear();
  for (const std::int32_t i : list_) {
    const FactorRef ref{family->id(), i};
    // It is evaluated anyway, and without a second-order term: under another loss its residual has
    // not been seen to be steady.
    if (factors_[family->id()].Has(i)) {
      family->Unsettle(i);
      continue;
    }
    // The rows as they are in S, before Reweigh writes over J and q.
    const std::ptrdiff_t kept = schur_.KeepFactor(ref);
    const double cost = family->weighed().Cost(i);
    if (family->Reweigh(i)) {
      schur_.ReplaceFactor(ref, kept);
      // The change alone: the factor was and stays part of the sum.
      cost_.Add(family->weighed().Cost(i) - cost);
      const std::int32_t landmark = schur_.structure().LandmarkOfFactor(ref);
      if (landmark >= 0) {
        // P and η are sums over the factor, so the landmark's contribution follows with the next
        // elimination.
        MarkLandmark(landmark);
      }
      reweighed_list_.push_back(ref);
    } else {
      MarkChanged(ref);
    }
    schur_.DropKept();
  }
}

Status DirtySubgraph::Linearize(bool by_difference) {
  for (IncrementalFamily& family : families_) {
    factors_[family.id()].CopyTo(&list_);
    Status linearized = LinearizeFamily(&family, by_difference);
    if (!linearized.ok()) {
      return linearized;
    }
    factors_[family.id()].Clear();
    waiting_[family.id()].Clear();
  }
  return Status::Ok();
}

// In three passes over the list: what is known of the old linearizations goes into kept_ and out of
// the cost; the family is evaluated on threads; the new ones take their places in S. An evaluation
// that fails leaves the cost of before.
Status DirtySubgraph::LinearizeFamily(IncrementalFamily* family, bool by_difference) {
  const double cost = cost_.value();
  Status status = Keep(family, by_difference);
  status = status.ok() ? EvaluateFamily(family) : status;
  if (!status.ok()) {
    cost_.TakeBack(cost);
    return status;
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
  return Status::Ok();
}

// Before Jacobians are written over: the listed factors' costs go out, their contributions to S are
// kept, and tangent maps are those of the values now.
Status DirtySubgraph::Keep(IncrementalFamily* family, bool by_difference) {
  kept_.clear();
  for (const std::int32_t i : list_) {
    const FactorRef ref{family->id(), i};
    const std::int32_t landmark = schur_.structure().LandmarkOfFactor(ref);
    if (landmark >= 0) {
      MarkLandmark(landmark);
    }
    if (family->weighed().linearized(i)) {
      cost_.Add(-family->weighed().Cost(i));
    }
    if (by_difference) {
      // A new factor has nothing to be replaced and is added.
      kept_.push_back(family->weighed().linearized(i) ? schur_.KeepFactor(ref) : -1);
    }
    for (int s = 0; s < family->num_slots(); ++s) {
      const VariableId id = family->variables(i)[s];
      // M = ∂(x ⊞ δ)/∂δ of each variable, at most once a move, before threads read it.
      if (!variables_.RefreshMap(graph_, id)) {
        return Status::Error(
            StatusCode::kEvaluationFailed,
            "the manifold of variable " + std::to_string(id) + " has no Jacobian here");
      }
    }
  }
  return Status::Ok();
}

Status DirtySubgraph::EvaluateFamily(IncrementalFamily* family) {
  const EvaluationFailure failure = family->Linearize(list_, executor_);
  if (failure.failed()) {
    return Status::Error(StatusCode::kEvaluationFailed,
                         graph_.DescribeFailure(family->id(), failure,
                                                family->linearized_parameters(failure.factor)));
  }
  for (const std::int32_t i : list_) {
    cost_.Add(family->weighed().Cost(i));
  }
  // A cost that is not finite would spoil every difference from here on.
  return std::isfinite(cost_.value()) ? Status::Ok() : InfiniteCost(*family);
}

// What has made the cost infinite or NaN, among the factors that were linearized just now.
Status DirtySubgraph::InfiniteCost(const IncrementalFamily& family) const {
  const auto culprit = std::find_if(list_.begin(), list_.end(), [&family](std::int32_t i) {
    return !std::isfinite(family.weighed().Cost(i));
  });
  return Status::Error(StatusCode::kEvaluationFailed,
                       culprit == list_.end() ? "the sum of all costs is not finite"
                                              : graph_.DescribeFactor(family.id(), *culprit) +
                                                    ": its cost is not finite");
}

int DirtySubgraph::Eliminate(double lambda) {
  landmarks_.ForEach([&](std::int32_t landmark) { schur_.PutIn(landmark, lambda); });
  const int count = landmarks_.count();
  landmarks_.Clear();
  return count;
}

}  // namespace inceres::internal
