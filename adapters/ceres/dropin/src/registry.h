#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include <ceres/cost_function.h>
#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>

#include "adapters/ceres/dropin/src/living_objects.h"
#include "inceres/ceres/session.h"

namespace inceres::internal {

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

}  // namespace inceres::internal
