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
    reweighed_.resize(families_.size());
  }
  factors_[family].Grow(families_[family].num_places());
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
bool DirtySubgraph::RebuildIsCheaper(int num_factors) const {
  double difference = 0.0;
  const auto anew = static_cast<double>(num_factors + schur_.NumPairs());
  for (const IncrementalFamily& family : families_) {
    factors_[family.id()].ForEach([&](std::int32_t i) {
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

void DirtySubgraph::Recenter(const IncrementalFamily& family,
                             const std::vector<std::int32_t>& factors) {
  if (!family.family().Recenters()) {
    return;
  }
  for (const std::int32_t i : factors) {
    if (family.Recenter(i)) {
      ++num_recentered_;
      MarkChanged({family.id(), i});
    }
  }
}

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
    // It is linearized anyway, under the loss that it has by now.
    if (factors_[family->id()].Has(i)) {
      family->Unsettle(i);
      continue;
    }
    const std::ptrdiff_t kept = schur_.KeepFactor(ref);
    const double cost = family->Cost(i);
    if (family->Reweigh(i)) {
      schur_.ReplaceFactor(ref, kept);
      cost_.Add(family->Cost(i) - cost);
      const std::int32_t landmark = schur_.structure().LandmarkOfFactor(ref);
      if (landmark >= 0) {
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
  }
  return Status::Ok();
}

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
    if (family->linearized(i)) {
      cost_.Add(-family->Cost(i));
    }
    if (by_difference) {
      kept_.push_back(family->linearized(i) ? schur_.KeepFactor(ref) : -1);
    }
    for (int s = 0; s < family->num_slots(); ++s) {
      const VariableId id = family->variables(i)[s];
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
    return Status::Error(
        StatusCode::kEvaluationFailed,
        graph_.DescribeFailure(family->id(), failure, family->parameters(failure.factor)));
  }
  for (const std::int32_t i : list_) {
    cost_.Add(family->Cost(i));
  }
  return std::isfinite(cost_.value()) ? Status::Ok() : InfiniteCost(*family);
}

// What has made the cost infinite or NaN, among the factors that were linearized just now.
Status DirtySubgraph::InfiniteCost(const IncrementalFamily& family) const {
  const auto culprit = std::find_if(list_.begin(), list_.end(), [&family](std::int32_t i) {
    return !std::isfinite(family.Cost(i));
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
