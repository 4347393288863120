#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <utility>
#include <vector>

#include <ceres/cost_function.h>
#include <ceres/covariance.h>
#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>

#include "adapters/ceres/covariance/problem_covariance.h"
#include "inceres/ceres/session.h"

namespace inceres::internal {

/// What is known of the living objects of a process by address. An entry is made by an object's
/// constructor and ends with its destructor, before the address can be used again.
///
/// Threads: any. Cost: a lock and a hash lookup a call. Entries are destroyed outside the lock: a
/// session is large.
template <typename Object, typename Entry>
class LivingObjects {
 public:
  /// One has been constructed here. Whatever was known of this address is forgotten.
  void Add(const Object* object, std::unique_ptr<Entry> entry) {
    const std::lock_guard<std::mutex> lock(mutex_);
    entries_[object].swap(entry);
  }
  std::unique_ptr<Entry> Take(const Object* object) {
    std::unique_ptr<Entry> taken;
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = entries_.find(object);
    if (found != entries_.end()) {
      taken = std::move(found->second);
      entries_.erase(found);
    }
    return taken;
  }
  /// Null if its constructor has not been seen. Valid as long as the object lives.
  Entry* Find(const Object* object) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = entries_.find(object);
    return found == entries_.end() ? nullptr : found->second.get();
  }
  int size() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return static_cast<int>(entries_.size());
  }

 private:
  mutable std::mutex mutex_;
  std::unordered_map<const Object*, std::unique_ptr<Entry>> entries_;
};

/// What the drop-in has seen happen to a living ceres::Problem and what it keeps for it.
///
/// Threads: as Ceres's own Problem, one at a time; `busy` alone may be asked from several.
struct KnownProblem {
  explicit KnownProblem(ceres::EvaluationCallback* callback) : evaluation_callback(callback) {}

  /// from Problem::Options, which Ceres up to 2.1 shows to nobody
  ceres::EvaluationCallback* evaluation_callback;

  std::int64_t num_solves = 0;  ///< of this Problem, by whichever solver
  bool has_bounds = false;      ///< one was set, at any time

  // Kept in incremental and auto mode, from the first solve on.
  /// since the session was last asked: a block added or removed, a constant, manifold or bound set
  bool edited = false;
  /// Cost functions of the residual blocks added since the last solve. Their contents may have
  /// changed even if residual block, address and residual are all those of a residual block removed
  /// before.
  std::vector<const ceres::CostFunction*> added_cost_functions;

  std::unique_ptr<CeresSession> session;  ///< from the second solve on, if that is incremental
  std::atomic<bool> busy{
      false};  ///< a solve uses the session: a solve nested in it, of the same Problem, may not
};

/// The living Problems of a process: all that the drop-in remembers. An entry goes with its Problem
/// when that is moved.
class Registry : public LivingObjects<ceres::Problem, KnownProblem> {
 public:
  /// `to` has taken over what `from` was; `from` is an empty shell. Both may be the same.
  void Move(const ceres::Problem* from, const ceres::Problem* to);

  /// inceres has solved one of them.
  void CountSolve() { ++num_solves_; }
  std::int64_t num_solves() const { return num_solves_; }

 private:
  std::atomic<std::int64_t> num_solves_{0};
};

/// The process's only one. It is never destroyed: static Problems may outlive everything.
Registry& TheRegistry();

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
