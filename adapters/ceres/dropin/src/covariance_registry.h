#pragma once

#include <memory>
#include <mutex>
#include <unordered_map>

#include <ceres/covariance.h>
#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>

#include "adapters/ceres/covariance/problem_covariance.h"

namespace inceres::internal {

/// The living ceres::Covariance objects of a process by address, with their options and what was
/// computed in their place.
///
/// Threads: any, on different objects. Cost: a lock and a hash lookup a call.
class CovarianceRegistry {
 public:
  /// One has been constructed here. Whatever was known of this address is forgotten.
  void Add(const ceres::Covariance* covariance, const ceres::Covariance::Options& options);
  void Remove(const ceres::Covariance* covariance);

  /// Computes in the place of an object whose constructor was seen; false, and nothing is kept, if
  /// that is stock's to do, for this reason or another, which is said in the log.
  bool Compute(const ceres::Covariance* covariance, const ProblemCovariance::Pairs& pairs,
               const ceres::Problem& problem, ceres::EvaluationCallback* callback, bool* computed);

  /// What Compute has computed; null if it was stock, or nothing was. After a failure too: stock's
  /// object, which then is asked, says what it says before its Compute.
  const ProblemCovariance* Find(const ceres::Covariance* covariance) const;

 private:
  struct Entry {
    ceres::Covariance::Options options;
    std::unique_ptr<ProblemCovariance> ours;
  };
  Entry* EntryOf(const ceres::Covariance* covariance);

  mutable std::mutex mutex_;
  std::unordered_map<const ceres::Covariance*, std::unique_ptr<Entry>> entries_;
};

/// The process's only one. It is never destroyed: static objects may outlive everything.
CovarianceRegistry& TheCovariances();

}  // namespace inceres::internal
