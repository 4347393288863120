#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <ceres/cost_function.h>
#include <ceres/iteration_callback.h>
#include <ceres/solver.h>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// What check_gradients adds to a solve: for its lifetime the view's residual blocks have cost
/// functions that compare each Jacobian they compute with numeric differences
/// (ceres::GradientChecker), and a callback that aborts at the end of the iteration in which one
/// was wrong. Residual blocks that cannot move are left alone.
///
/// Source: the obligations of Ceres's option; Ridders, "Accurate computation of F'(x) and
/// F'(x) F''(x)", 1982, for the differences. Cost: tens of evaluations for each entry of a
/// Jacobian. Threads: cost functions may be called concurrently.
class GradientCheck : public ceres::IterationCallback {
 public:
  GradientCheck(const ceres::Solver::Options& options, ProblemView* view);
  ~GradientCheck() override;
  GradientCheck(const GradientCheck&) = delete;
  GradientCheck& operator=(const GradientCheck&) = delete;

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override;

  /// Whether some Jacobian was wrong.
  bool failed() const { return !errors_.empty(); }
  /// Ceres's message, residual blocks in their order in the problem whatever the order or the
  /// threads they were evaluated in.
  std::string message() const;

  /// Of a residual block, by its index: told by its cost function.
  void Note(std::size_t residual, const std::string& error);

 private:
  ProblemView& view_;
  std::vector<std::unique_ptr<ceres::CostFunction>> checked_;  // null: left alone
  std::vector<const ceres::CostFunction*> given_;
  mutable std::mutex mutex_;
  std::map<std::size_t, std::string> errors_;
};

}  // namespace inceres::internal
