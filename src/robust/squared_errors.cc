#include "robust/squared_errors.h"

#include <cmath>
#include <set>
#include <string>
#include <utility>

#include "base/address.h"

// Errors of suspects, ‖f‖² without their losses, at values that need not be the graph's own. One
// factor a call: suspects are few and scattered among a family's places.

namespace inceres::internal {

std::string NameOfSuspect(const FactorGraph& graph, FactorId factor) {
  // Names are needed for suspects that are not there as well.
  if (factor.family < 0 || factor.family >= graph.num_families()) {
    return "factor " + std::to_string(factor.index) + " of family " + std::to_string(factor.family);
  }
  return std::string(graph.family(factor.family).Name()) + " " + std::to_string(factor.index);
}

// Asked before anything is evaluated: a suspect that is named twice would count twice.
Status CheckSuspects(const FactorGraph& graph, const std::vector<FactorId>& factors) {
  std::set<std::pair<FamilyId, std::int32_t>> seen;
  for (const FactorId& id : factors) {
    // A generation below zero is that of whoever holds the place now.
    const bool there =
        graph.HasFactor(id.family, id.index) &&
        (id.generation < 0 || id.generation == graph.Generation(id.family, id.index));
    if (!there) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "the suspect " + NameOfSuspect(graph, id) + " is not in the graph");
    }
    if (!seen.insert({id.family, id.index}).second) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "the suspect " + NameOfSuspect(graph, id) + " is named twice");
    }
  }
  return Status::Ok();
}

// Losses are not asked: a suspect whose weight is 0 has an error all the same, and it is by this
// error that the weight may come back.
Status SquaredErrors(const FactorGraph& graph, const std::vector<FactorId>& factors,
                     const GncValues& values, std::vector<double>* errors) {
  std::vector<const double*> parameters;
  std::vector<double> residuals;
  errors->assign(factors.size(), 0.0);
  // In the order of the list, and up to the first that fails.
  for (std::size_t k = 0; k < factors.size(); ++k) {
    const FactorId id = factors[k];
    const FactorFamily& family = graph.family(id.family);
    const VariableId* const ids = graph.Variables(id.family, id.index);
    parameters.clear();
    for (int s = 0; s < family.num_slots(); ++s) {
      parameters.push_back(values(ids[s]));
    }
    residuals.resize(static_cast<std::size_t>(family.residual_size()));
    // A batch counts from the family's first factor, so both arrays pretend to begin where that
    // one's entries would be: addresses that are numbers only. Without Jacobians: residuals only,
    // no loss.
    FactorBatch batch;
    batch.begin = id.index;
    batch.end = id.index + 1;
    batch.parameters =
        AddressBefore(std::ptrdiff_t{id.index} * family.num_slots(), parameters.data());
    batch.residuals =
        AddressBefore(std::ptrdiff_t{id.index} * family.residual_size(), residuals.data());
    const EvaluationFailure failure = family.Evaluate(batch);
    double& error = (*errors)[k];
    for (const double residual : residuals) {
      error += residual * residual;
    }
    // Not finite counts as a failure: a weight of it would be NaN.
    if (failure.failed() || !std::isfinite(error)) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "the suspect " + NameOfSuspect(graph, id) + " cannot be evaluated: " +
                               (failure.failed() ? failure.reason : "its error is not finite"));
    }
  }
  return Status::Ok();
}

// f is whitened: its square is distributed as chi-square.
double ThresholdOf(const GncOptions& options, const FactorFamily& family) {
  return options.threshold_scale *
         ChiSquareQuantile(options.inlier_probability, family.residual_size());
}

void AddVerdict(FactorId factor, double squared_error, double threshold, double weight,
                GncSummary* summary) {
  const bool inlier = squared_error <= threshold;
  summary->verdicts.push_back({factor, squared_error, threshold, weight, inlier});
  summary->num_outliers += inlier ? 0 : 1;
}

}  // namespace inceres::internal
