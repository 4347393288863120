#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "adapters/ceres/plan/solve_input.h"
#include "adapters/ceres/read/introspection.h"
#include "inceres/solver/solver.h"

namespace inceres::internal {

/// The last few things that were put in, for whoever can use one again; the one that has waited
/// longest makes room for a new one. Guarded; nothing is destroyed under the lock. `Pointer` is one
/// that may be null.
template <typename Pointer>
class LastFew {
 public:
  static constexpr std::size_t kMax = 4;

  /// Takes out the latest that suits; null if none does.
  template <typename Suits>
  Pointer Take(const Suits& suits) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return FindLast(suits) ? PopLast() : Pointer();
  }

  /// The same of what may be shared, which stays in as the latest.
  template <typename Suits>
  Pointer Share(const Suits& suits) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return FindLast(suits) ? kept_.back() : Pointer();
  }

  void Put(Pointer pointer) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (kept_.size() < kMax) {
      kept_.push_back(std::move(pointer));
    } else {
      std::rotate(kept_.begin(), kept_.begin() + 1, kept_.end());
      kept_.back().swap(pointer);  // the argument is destroyed when the lock is free again
    }
  }

  void Clear() {
    std::vector<Pointer> forgotten;
    const std::lock_guard<std::mutex> lock(mutex_);
    forgotten.swap(kept_);
  }

 private:
  // Moves the latest that suits to the end; false if none does.
  template <typename Suits>
  bool FindLast(const Suits& suits) {
    const auto found = std::find_if(kept_.rbegin(), kept_.rend(),
                                    [&suits](const Pointer& kept) { return suits(*kept); });
    if (found == kept_.rend()) {
      return false;
    }
    std::rotate(std::prev(found.base()), found.base(), kept_.end());
    return true;
  }
  Pointer PopLast() {
    Pointer last = std::move(kept_.back());
    kept_.pop_back();
    return last;
  }

  std::mutex mutex_;
  std::vector<Pointer> kept_;  // the latest at the end
};

/// What solves of small problems leave to the next ones of the same structure, for a window
/// estimator builds a new ceres::Problem every frame, often of a shape it had before: memory of
/// views, plans of graphs, and solvers of the core that are set up. All are found by content, never
/// by address, and nothing that was computed from numbers is used again. Plans are
/// kept of larger problems, too, for a covariance that follows a solve, or another one: making a
/// plan takes several times as long as comparing one. Beyond that set-up is a small share, and
/// memory worth more.
///
/// Threads: any. Concurrent solves, and one within another, take a view and a solver each, and
/// share plans, which nobody changes.
class StructureCache {
 public:
  /// Residual blocks and slots of a problem whose plan is kept.
  static constexpr std::size_t kMaxNumbers = std::size_t{1} << 17;  // two megabytes a plan
  /// Of a solver that is kept.
  static constexpr std::int64_t kMaxSolverBytes = std::int64_t{16} << 20;

  /// The process's. Never destroyed: a solve may come as late as another library's destructors.
  static StructureCache& OfProcess();

  /// An empty view.
  std::unique_ptr<ProblemView> TakeView();
  void GiveBack(std::unique_ptr<ProblemView> view);

  /// The plan for this problem and effective linear solver: one that was kept or else a new one. If
  /// that is not kept either, it is *own, too. Several threads share what is new.
  std::shared_ptr<const GraphPlan> PlanFor(const ProblemView& view, const OrderingView& ordering,
                                           ceres::LinearSolverType type,
                                           std::shared_ptr<GraphPlan>* own, int num_threads = 1);

  /// A solver that is ready for this graph, else a new one.
  std::unique_ptr<Solver> TakeSolver(const SolverOptions& options, const FactorGraph& graph);
  void GiveBack(std::unique_ptr<Solver> solver);

  void Clear();

 private:
  struct KnownPlan;

  LastFew<std::unique_ptr<ProblemView>> views_;
  LastFew<std::shared_ptr<const KnownPlan>> plans_;
  LastFew<std::unique_ptr<Solver>> solvers_;
};

/// Finds or makes the input's plan, where there is anything to solve for. Returns what forbids it,
/// or nothing.
std::string ChoosePlan(ceres::LinearSolverType type, SolveInput* input);

}  // namespace inceres::internal
