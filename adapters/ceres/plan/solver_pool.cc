#include "adapters/ceres/plan/solver_pool.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "adapters/ceres/plan/plan_pool.h"
#include "adapters/ceres/plan/view_pool.h"
#include "inceres/ceres/solve.h"

namespace inceres {
namespace internal {

SolverPool& SolverPool::Global() {
  static auto& kPool = *new SolverPool;
  return kPool;
}

std::unique_ptr<Solver> SolverPool::Take(const SolverOptions& options, const FactorGraph& graph) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found =
      std::find_if(idle_.rbegin(), idle_.rend(), [&](const auto& solver) { return solver->IsReadyFor(options, graph); });
  if (found == idle_.rend()) {
    return std::make_unique<Solver>(kMaxIdleBytes);
  }
  std::unique_ptr<Solver> solver = std::move(*found);
  idle_.erase(std::next(found).base());
  return solver;
}

void SolverPool::GiveBack(std::unique_ptr<Solver> solver) {
  if (solver->Bytes() == 0) {
    return;
  }
  std::unique_ptr<Solver> oldest;  // destroyed when the lock is free again
  const std::lock_guard<std::mutex> lock(mutex_);
  if (idle_.size() == kMaxIdle) {
    oldest = std::move(idle_.front());
    idle_.erase(idle_.begin());
  }
  idle_.push_back(std::move(solver));
}

void SolverPool::Clear() {
  std::vector<std::unique_ptr<Solver>> forgotten;
  const std::lock_guard<std::mutex> lock(mutex_);
  forgotten.swap(idle_);
}

}  // namespace internal

void ForgetStructures() {
  internal::PlanPool::Global().Clear();
  internal::SolverPool::Global().Clear();
  internal::ViewPool::Global().Clear();
}

}  // namespace inceres
