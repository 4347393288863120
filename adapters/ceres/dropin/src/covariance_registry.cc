#include "adapters/ceres/dropin/src/covariance_registry.h"

#include <utility>

#include <glog/logging.h>

namespace inceres::internal {

bool CovarianceRegistry::Compute(const ceres::Covariance* covariance,
                                 const ProblemCovariance::Pairs& pairs,
                                 const ceres::Problem& problem, ceres::EvaluationCallback* callback,
                                 bool* computed) {
  KnownCovariance* entry = Find(covariance);
  if (entry == nullptr) {
    return false;
  }
  entry->ours.reset();
  auto ours = std::make_unique<ProblemCovariance>();
  const ProblemCovariance::Outcome outcome =
      ours->Compute(entry->options, pairs, problem, callback);
  if (outcome == ProblemCovariance::Outcome::kDeclined) {
    LOG(INFO) << "inceres: a covariance is left to Ceres: " << ours->message();
    return false;
  }
  *computed = outcome == ProblemCovariance::Outcome::kComputed;
  if (*computed) {
    entry->ours = std::move(ours);
  }
  return true;
}

CovarianceRegistry& TheCovariances() {
  static CovarianceRegistry& registry = *new CovarianceRegistry;  // never destroyed
  return registry;
}

}  // namespace inceres::internal
