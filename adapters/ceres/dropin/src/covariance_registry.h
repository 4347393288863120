#pragma once

#include <memory>

#include <ceres/covariance.h>
#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>

#include "adapters/ceres/covariance/problem_covariance.h"
#include "adapters/ceres/dropin/src/living_objects.h"

namespace inceres::internal {

/// The options of a ceres::Covariance object, and what was computed in its place.
struct KnownCovariance {
  explicit KnownCovariance(const ceres::Covariance::Options& given) : options(given) {}

  ceres::Covariance::Options options;
  std::unique_ptr<ProblemCovariance> ours;
  bool has_failed = false;  // the last Compute, which was ours
};

/// The living ceres::Covariance objects of a process. Threads: any, on different objects.
class CovarianceRegistry : public LivingObjects<ceres::Covariance, KnownCovariance> {
 public:
  /// Computes in the place of an object whose constructor was seen; false, and nothing is kept, if
  /// that is stock's to do, for this reason or another, which is said in the log.
  bool Compute(const ceres::Covariance* covariance, const ProblemCovariance::Pairs& pairs,
               const ceres::Problem& problem, ceres::EvaluationCallback* callback, bool* computed);

  /// What was computed before is out of date: the next is stock's.
  void Forget(const ceres::Covariance* covariance);

  /// What Compute has computed; null if it was stock, or nothing was. After a Compute that has
  /// failed it ends the process, as Ceres does.
  const ProblemCovariance* Computed(const ceres::Covariance* covariance) const;
};

/// The process's only one. It is never destroyed: static objects may outlive everything.
CovarianceRegistry& TheCovariances();

}  // namespace inceres::internal
