#include "adapters/ceres/dropin/src/registry.h"

#include <utility>

#include <glog/logging.h>

namespace inceres::internal {

// Of a Problem that nothing is known of nothing is known afterwards, where it is now.
void Registry::Move(const ceres::Problem* from, const ceres::Problem* to) {
  if (from == to) {
    return;
  }
  std::unique_ptr<KnownProblem> entry = Take(from);
  const std::unique_ptr<KnownProblem> replaced = Take(to);
  if (entry != nullptr) {
    Add(to, std::move(entry));
  }
}

Registry& TheRegistry() {
  static Registry& registry = *new Registry;
  return registry;
}

bool CovarianceRegistry::Compute(const ceres::Covariance* covariance,
                                 const ProblemCovariance::Pairs& pairs,
                                 const ceres::Problem& problem, ceres::EvaluationCallback* callback,
                                 bool* computed) {
  KnownCovariance* entry = Find(covariance);
  if (entry == nullptr) {
    return false;
  }
  Forget(covariance);
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
  entry->has_failed = !*computed;
  return true;
}

void CovarianceRegistry::Forget(const ceres::Covariance* covariance) {
  if (KnownCovariance* const entry = Find(covariance)) {
    entry->ours.reset();
    entry->has_failed = false;
  }
}

// In Ceres's words. Its own object may have computed before, and would give that out.
const ProblemCovariance* CovarianceRegistry::Computed(const ceres::Covariance* covariance) const {
  const KnownCovariance* const known = Find(covariance);
  if (known == nullptr) {
    return nullptr;
  }
  CHECK(!known->has_failed) << "Covariance is asked for when Covariance::Compute returned false.";
  return known->ours.get();
}

CovarianceRegistry& TheCovariances() {
  static CovarianceRegistry& registry = *new CovarianceRegistry;  // never destroyed
  return registry;
}

}  // namespace inceres::internal
