#include "adapters/ceres/dropin/src/covariance_registry.h"

#include <utility>

#include <glog/logging.h>

namespace inceres::internal {

void CovarianceRegistry::Add(const ceres::Covariance* covariance,
                             const ceres::Covariance::Options& options) {
  auto entry = std::make_unique<Entry>();
  entry->options = options;
  const std::lock_guard<std::mutex> lock(mutex_);
  entries_[covariance].swap(entry);
}

void CovarianceRegistry::Remove(const ceres::Covariance* covariance) {
  std::unique_ptr<Entry> removed;
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = entries_.find(covariance);
  if (found != entries_.end()) {
    removed = std::move(found->second);
    entries_.erase(found);
  }
}

CovarianceRegistry::Entry* CovarianceRegistry::EntryOf(const ceres::Covariance* covariance) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = entries_.find(covariance);
  return found == entries_.end() ? nullptr : found->second.get();
}

bool CovarianceRegistry::Compute(const ceres::Covariance* covariance,
                                 const ProblemCovariance::Pairs& pairs,
                                 const ceres::Problem& problem, ceres::EvaluationCallback* callback,
                                 bool* computed) {
  Entry* entry = EntryOf(covariance);
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

const ProblemCovariance* CovarianceRegistry::Find(const ceres::Covariance* covariance) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = entries_.find(covariance);
  return found == entries_.end() ? nullptr : found->second->ours.get();
}

CovarianceRegistry& TheCovariances() {
  static CovarianceRegistry& registry = *new CovarianceRegistry;  // never destroyed
  return registry;
}

}  // namespace inceres::internal
