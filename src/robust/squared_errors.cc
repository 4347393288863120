#include "robust/squared_errors.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

// Errors of suspects, ‖f‖² without their losses, at values that need not be the graph's own. One
// factor a call: suspects are few and scattered among a family's places.

namespace inceres::internal {
namespace {

// Evaluates one factor of a family. A batch counts from the family's first factor, so there is a
// pointer for each place up to the factor's, of which only its own are read. The pointers of other
// places stay null, or are those of suspects that were measured before; a family reads what begin
// and end name and nothing else. Cost of a measurement: one residual, and room once for as many
// pointers as the family has places up to it.
class ErrorMeter {
 public:
  ErrorMeter(const FactorGraph& graph, const GncValues& values) : graph_(graph), values_(values) {}

  EvaluationFailure Measure(FactorId id, double* squared_error) {
    const FactorFamily& family = graph_.family(id.family);
    const auto rows = static_cast<std::size_t>(family.residual_size());
    const auto slots = static_cast<std::size_t>(family.num_slots());
    const auto place = static_cast<std::size_t>(id.index);
    // Grows to the largest place that was asked for.
    parameters_.resize(std::max(parameters_.size(), (place + 1) * slots));
    residuals_.resize(std::max(residuals_.size(), (place + 1) * rows));
    for (std::size_t s = 0; s < slots; ++s) {
      parameters_[place * slots + s] = values_(graph_.Variables(id.family, id.index)[s]);
    }
    FactorBatch batch;
    // Without jacobians: residuals only, no loss.
    batch.begin = id.index;
    batch.end = id.index + 1;
    batch.parameters = parameters_.data();
    batch.residuals = residuals_.data();
    const EvaluationFailure failure = family.Evaluate(batch);
    // Also after a failure, when it is not used.
    *squared_error = 0.0;
    for (std::size_t r = place * rows; r < (place + 1) * rows; ++r) {
      *squared_error += residuals_[r] * residuals_[r];
    }
    return failure;
  }

 private:
  const FactorGraph& graph_;
  const GncValues& values_;
  std::vector<const double*> parameters_;
  std::vector<double> residuals_;
};

}  // namespace

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
        id.family >= 0 && id.family < graph.num_families() && id.index >= 0 &&
        id.index < graph.NumFactors(id.family) && graph.HasFactor(id.family, id.index) &&
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
  // In the order of the list, and up to the first that fails.
  ErrorMeter meter(graph, values);
  errors->resize(factors.size());
  for (std::size_t k = 0; k < factors.size(); ++k) {
    // Not finite counts as a failure: a weight of it would be NaN.
    const EvaluationFailure failure = meter.Measure(factors[k], &(*errors)[k]);
    if (failure.failed() || !std::isfinite((*errors)[k])) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "the suspect " + NameOfSuspect(graph, factors[k]) +
                               " cannot be evaluated: " +
                               (failure.failed() ? failure.reason : "its error is not finite"));
    }
  }
  return Status::Ok();
}

}  // namespace inceres::internal
