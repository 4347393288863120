#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "inceres/solver/solver.h"

namespace inceres::internal {

/// Solvers of the core that wait for the next problem of their structure: a window estimator builds a new ceres::Problem every
/// frame, often of a shape it had before. Guarded: concurrent solves each take a solver of their own. At most kMaxIdle wait, and
/// none holds more than kMaxIdleBytes: where set-up is a small share, memory is worth more.
class SolverPool {
 public:
  static constexpr std::size_t kMaxIdle = 4;
  static constexpr std::int64_t kMaxIdleBytes = std::int64_t{16} << 20;

  /// The process's. Never destroyed: a solve may come as late as another library's destructors.
  static SolverPool& Global();

  /// A waiting solver that is ready for this graph, else a new one.
  std::unique_ptr<Solver> Take(const SolverOptions& options, const FactorGraph& graph);

  /// For the next one; the solver that has waited longest makes room.
  void GiveBack(std::unique_ptr<Solver> solver);

  void Clear();

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<Solver>> idle_;  // the one used last at the end
};

}  // namespace inceres::internal
