#include "inceres/solver/marginalization.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "base/option_rules.h"
#include "linearize/jacobian_map.h"
#include "marginal/marginal_system.h"
#include "marginal/marginalize.h"
#include "problem/find_fault.h"

namespace inceres {

// Marginalization as a transaction on a graph (docs/algorithms.md, "Marginalization"): check what
// is asked for, collect the factors concerned and the variables that stay, compute the prior, and
// apply one edit that removes what goes and adds the prior. Everything that may fail comes before
// the edit, and the edit is carried out whole or not at all; so on an error nothing has changed.
//
// The algebra is MarginalSystem's. Here it is decided which variables have columns: marginalized
// ones that move, and neighbors that stay, in the order of the request and then by id. Rows come
// from the Jacobians that a live solver keeps, where it has them, or from an evaluation at the
// current values; damping plays no part.

Status MarginalizationOptions::Validate() const {
  return internal::OptionRules("MarginalizationOptions")
      .Require(epsilon >= 0.0 && std::isfinite(epsilon), "epsilon", epsilon, "finite and >= 0")
      .Require(rank_tolerance >= 0.0 && rank_tolerance < 1.0, "rank_tolerance", rank_tolerance,
               "in [0, 1)")
      .status();
}

namespace internal {
namespace {

// The priors that marginalization makes; kept apart from those a user adds, which may not be
// written to. A graph gives its families out as constant: these say by themselves who may write,
// which is the graph they were made for and none of its copies, that have the same families.
class OwnPriorFamily final : public LinearPriorFamily {
 public:
  static std::shared_ptr<OwnPriorFamily> Make(const LinearPrior& shape, const FactorGraph* graph) {
    auto made = std::make_shared<OwnPriorFamily>(shape);
    made->graph_ = graph;
    made->self_ = made;
    return made;
  }
  using LinearPriorFamily::LinearPriorFamily;
  bool IsOf(const FactorGraph& graph) const { return graph_ == &graph; }
  std::shared_ptr<OwnPriorFamily> self() const { return self_.lock(); }

 private:
  const FactorGraph* graph_ = nullptr;
  std::weak_ptr<OwnPriorFamily> self_;
};

// The order in which factors are taken: that of the graph.
bool Before(FactorId a, FactorId b) {
  return std::tie(a.family, a.index) < std::tie(b.family, b.index);
}

// One call: what it finds out lives in its members, and it runs once.
class Marginalizer {
 public:
  Marginalizer(const MarginalizationTarget& target, const MarginalizationRequest& request,
               const MarginalizationOptions& options)
      : target_(target),
        graph_(*target.graph),
        request_(request),
        options_(options),
        system_(graph_, options) {}

  MarginalizationSummary Run() {
    Status& status = summary_.status;
    // Step by step, the first failure being the result.
    const auto then = [&](auto step) { status = status.ok() ? (this->*step)() : status; };
    status = options_.Validate();
    then(&Marginalizer::CheckIds);
    if (status.ok()) {
      CollectFactors();
      CollectKept();
    }
    then(&Marginalizer::CheckConstants);
    then(&Marginalizer::CheckLandmarks);
    then(&Marginalizer::CheckRemoval);
    then(&Marginalizer::ComputePrior);
    then(&Marginalizer::Apply);
    if (!status.ok()) {
      // What was found out on the way is of no use: nothing has changed.
      MarginalizationSummary failed;
      failed.status = std::move(status);
      failed.offenders = std::move(summary_.offenders);
      return failed;
    }
    return std::move(summary_);
  }

 private:
  Status Refuse(VariableId id, const std::string& what) {
    summary_.offenders.push_back(id);
    return Status::Error(StatusCode::kInvalidArgument,
                         "variable " + std::to_string(id) + " " + what);
  }

  // Both lists of the request are looked at with one set: a variable goes one way or the other.
  Status CheckIds() {
    for (const std::vector<VariableId>* ids : {&request_.marginalized, &request_.dropped}) {
      for (const VariableId id : *ids) {
        if (!graph_.HasVariable(id)) {
          return Refuse(id, "is to be marginalized or dropped but does not exist");
        }
        if (!going_.insert(id).second) {
          return Refuse(id, "is to be marginalized or dropped twice");
        }
      }
    }
    std::set<VariableId> ordered;
    for (const VariableId id : request_.order) {
      if (!graph_.HasVariable(id) || going_.count(id) > 0) {
        return Refuse(id, "is named in the order of the prior but " +
                              std::string(going_.count(id) > 0 ? "goes" : "does not exist"));
      }
      if (!ordered.insert(id).second) {
        return Refuse(id, "is named twice in the order of the prior");
      }
    }
    return Status::Ok();
  }

  // Factors of the marginalized variables, but for those that are dropped, by themselves or with a
  // variable.
  void CollectFactors() {
    // Costs a pass over the graph the first time, unless it tracks the factors of its variables
    // already.
    graph_.TrackFactors();
    // What is dropped says nothing to the prior, even if it touches a marginalized variable.
    std::vector<FactorId> lost = request_.dropped_factors;
    for (const VariableId id : request_.dropped) {
      graph_.ForEachFactorOf(id, [&](FactorId factor) { lost.push_back(factor); });
    }
    std::sort(lost.begin(), lost.end(), Before);
    for (const VariableId id : request_.marginalized) {
      graph_.ForEachFactorOf(id, [&](FactorId factor) {
        if (!std::binary_search(lost.begin(), lost.end(), factor, Before)) {
          factors_.push_back(factor);
        }
      });
    }
    std::sort(factors_.begin(), factors_.end(), Before);
    const auto same = [](FactorId a, FactorId b) { return !Before(a, b) && !Before(b, a); };
    // A factor between two marginalized variables was found through either. Sorted by family and
    // index, the rows come in an order that does not depend on that of the request.
    factors_.erase(std::unique(factors_.begin(), factors_.end(), same), factors_.end());
  }

  // Constants have columns only if they are to be kept and have somewhere to move.
  bool HasColumns(VariableId id) const {
    return !graph_.IsConstant(id) ||
           (options_.keep_constants && going_.count(id) == 0 && graph_.TangentSize(id) > 0);
  }

  // Marginalized columns before kept ones: MarginalSystem relies on it.
  void CollectKept() {
    for (const VariableId id : request_.marginalized) {
      if (HasColumns(id)) {
        system_.AddMarginalized(id);
      }
    }
    // Whoever shares a factor with a marginalized variable and does not go.
    std::set<VariableId> neighbors;
    for (const FactorId& factor : factors_) {
      const VariableId* ids = graph_.Variables(factor.family, factor.index);
      std::copy_if(ids, ids + graph_.family(factor.family).num_slots(),
                   std::inserter(neighbors, neighbors.end()),
                   [&](VariableId id) { return HasColumns(id) && going_.count(id) == 0; });
    }
    std::vector<VariableId>& kept = summary_.kept;
    std::copy_if(request_.order.begin(), request_.order.end(), std::back_inserter(kept),
                 // Those that the request names, where the prior has them; erased, so that the
                 // others are left.
                 [&](VariableId id) { return neighbors.erase(id) > 0; });
    kept.insert(kept.end(), neighbors.begin(), neighbors.end());
    std::for_each(kept.begin(), kept.end(), [this](VariableId id) { system_.AddKept(id); });
  }

  // A constant need not have the degrees of freedom of its slots, until it is to have columns.
  Status CheckConstants() {
    for (const FactorId& factor : factors_) {
      const FactorFamily& family = graph_.family(factor.family);
      for (int s = 0; s < family.num_slots(); ++s) {
        const VariableId id = graph_.Variables(factor.family, factor.index)[s];
        if (graph_.IsConstant(id) && HasColumns(id) &&
            graph_.TangentSize(id) != family.slot(s).tangent_size) {
          return Refuse(id, "is a constant with " + std::to_string(graph_.TangentSize(id)) +
                                " degrees of freedom in a slot for " +
                                std::to_string(family.slot(s).tangent_size) +
                                ": the prior cannot keep it (keep_constants)");
        }
      }
    }
    return Status::Ok();
  }

  // The prior becomes a factor, and a factor may touch one landmark that is not constant: the block
  // structure of P rests on that.
  Status CheckLandmarks() {
    std::vector<VariableId> landmarks;
    std::copy_if(summary_.kept.begin(), summary_.kept.end(), std::back_inserter(landmarks),
                 [&](VariableId id) {
                   return graph_.role(id) == Role::kLandmark && !graph_.IsConstant(id);
                 });
    if (landmarks.size() < 2) {
      return Status::Ok();
    }
    summary_.offenders = landmarks;
    return Status::Error(
        StatusCode::kInvalidArgument,
        "the prior would join " + std::to_string(landmarks.size()) + " landmarks (variables " +
            std::to_string(landmarks[0]) + ", " + std::to_string(landmarks[1]) +
            (landmarks.size() > 2 ? ", …" : "") +
            "); a factor touches at most one: marginalize them too, or drop their factors");
  }

  // The half of the edit that is known before the prior is.
  GraphEdit Removal() const {
    GraphEdit edit(graph_);
    std::for_each(request_.dropped_factors.begin(), request_.dropped_factors.end(),
                  [&](FactorId id) { edit.RemoveFactor(id); });
    std::for_each(going_.begin(), going_.end(), [&](VariableId id) { edit.RemoveVariable(id); });
    return edit;
  }

  // Whatever could be wrong with the edit is found before a family is added, and before anything is
  // computed.
  Status CheckRemoval() {
    std::vector<FactorId> removed;
    return graph_.Check(Removal(), &removed);
  }

  Status ComputePrior() {
    // Jacobians of variables that have columns, and no others, whatever the graph says of
    // constancy.
    const auto wanted = [this](VariableId id) { return system_.Has(id); };
    FactorLinearizer linearizer(graph_, target_.values, wanted);
    const auto rows_of = [&](FactorId id, LinearizedFactor* factor) {
      // The kept Jacobian is that of the factor's last linearization: no evaluation.
      if (target_.cached != nullptr && target_.cached(id, wanted, factor)) {
        ++summary_.num_cached_factors;
        return Status::Ok();
      }
      return linearizer.Linearize(id, factor);
    };
    const Status status = system_.Eliminate(factors_, rows_of, &summary_.offenders);
    if (!status.ok()) {
      return status;
    }
    Eigen::MatrixXd rows = system_.result();
    // The factors themselves were finite; products of their entries need not be.
    if (!rows.allFinite()) {
      return Status::Error(StatusCode::kEvaluationFailed,
                           "the prior is not finite: the factors' weights overflow");
    }
    summary_.num_factors = static_cast<int>(factors_.size());
    summary_.fixed_cost = system_.fixed_cost();
    summary_.num_truncated = TruncatePrior(options_, &rows);
    // After truncation, as rows of zeros say nothing. No prior is added without any.
    summary_.rank =
        static_cast<int>((rows.leftCols(rows.cols() - 1).array() != 0.0).rowwise().any().count());
    WritePrior(rows);
    return Status::Ok();
  }

  void WritePrior(const Eigen::MatrixXd& rows) {
    for (const VariableId id : summary_.kept) {
      const double* x = target_.values(id);
      prior_.blocks.push_back(
          // x₀ is where the variables are now. The manifold is shared with the graph.
          {{x, x + graph_.AmbientSize(id)}, graph_.shared_manifold(id), graph_.TangentSize(id)});
    }
    const Eigen::Index n = rows.rows();
    prior_.J.resize(static_cast<std::size_t>(n * n));
    prior_.e0.resize(static_cast<std::size_t>(n));
    Eigen::Map<RowMajor>(prior_.J.data(), n, n) = rows.leftCols(n);
    Eigen::Map<Eigen::VectorXd>(prior_.e0.data(), n) = rows.col(n);
  }

  // A family of marginalization's own for priors of this shape.
  // Priors of one shape share a family, so a window that slides for ever has a bounded number of
  // them.
  FamilyHandle<OwnPriorFamily> FamilyForPrior() {
    for (FamilyId id = 0; id < graph_.num_families(); ++id) {
      const auto* own = dynamic_cast<const OwnPriorFamily*>(&graph_.family(id));
      if (own != nullptr && own->IsOf(graph_) && own->Fits(prior_)) {
        return {id, own->self()};
      }
    }
    return graph_.AddFamily(OwnPriorFamily::Make(prior_, &graph_));
  }

  Status Apply() {
    FamilyHandle<OwnPriorFamily> family;
    if (summary_.rank > 0) {
      family = FamilyForPrior();  // before the edit begins: a family that comes changes the graph
    }
    GraphEdit edit = Removal();
    if (summary_.rank > 0) {
      summary_.prior = edit.AddFactor(family, prior_, summary_.kept);
    } else {
      // Nothing is left to say about anybody.
      summary_.kept.clear();
    }
    for (const VariableId id : summary_.kept) {
      // Pinned for all of their factors (docs/algorithms.md, "Marginalization": first-estimate
      // Jacobians). Whoever is pinned already stays where he is.
      if (options_.first_estimate_jacobians && graph_.PinnedValues(id) == nullptr) {
        edit.PinLinearization(id, target_.values(id));
      }
    }
    return target_.apply(edit);
  }

  const MarginalizationTarget& target_;
  FactorGraph& graph_;
  const MarginalizationRequest& request_;
  const MarginalizationOptions& options_;
  MarginalSystem system_;
  MarginalizationSummary summary_;
  std::set<VariableId> going_;
  std::vector<FactorId> factors_;
  LinearPrior prior_;
};

}  // namespace

MarginalizationSummary MarginalizeOn(const MarginalizationTarget& target,
                                     const MarginalizationRequest& request,
                                     const MarginalizationOptions& options) {
  try {
    return Marginalizer(target, request, options).Run();
  } catch (const std::bad_alloc&) {
    // Memory that runs out is a status like the others and is not thrown at the caller.
    MarginalizationSummary failed;
    failed.status = Status::Error(StatusCode::kUnavailable, "Out of memory.");
    return failed;
  }
}

}  // namespace internal

MarginalizationSummary Marginalize(const MarginalizationRequest& request,
                                   const MarginalizationOptions& options, FactorGraph* graph) {
  const Status valid = graph->Validate();
  if (!valid.ok()) {
    MarginalizationSummary failed;
    failed.status = valid;
    return failed;
  }
  internal::MarginalizationTarget target;
  target.graph = graph;
  // A graph by itself holds its values; nothing of it has been linearized.
  target.values = [graph](VariableId id) { return graph->Values(id); };
  target.apply = [graph](const GraphEdit& edit) { return graph->Apply(edit); };
  return internal::MarginalizeOn(target, request, options);
}

}  // namespace inceres
