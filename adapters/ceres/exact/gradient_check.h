#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>

#include <ceres/solver.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/read/introspection.h"
#include "inceres/problem/factor_family.h"

namespace inceres::internal {

/// What check_gradients adds to a solve: families of the problem's cost functions that compare each
/// Jacobian they compute with numeric differences (ceres::GradientChecker). The solve is to be
/// aborted at the end of the iteration in which one was wrong.
///
/// Nothing here derives from a class of Ceres, whose type information is data of Ceres's library:
/// the drop-in must load where that is another one.
///
/// Source: the obligations of Ceres's option; Ridders, "Accurate computation of F'(x) and
/// F'(x) F''(x)", 1982, for the differences. Cost: tens of evaluations for each entry of a
/// Jacobian. Threads: cost functions may be called concurrently.
class GradientCheck {
 public:
  /// Borrows the options.
  explicit GradientCheck(const ceres::Solver::Options& options) : options_(options) {}

  /// The family of these residual blocks of the view; borrows their cost functions.
  std::shared_ptr<const FactorFamily> FamilyOf(const ProblemView& view,
                                               const GraphPlan::Family& family);

  /// Whether some Jacobian was wrong.
  bool failed() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return !errors_.empty();
  }
  /// Ceres's message, residual blocks in their order in the problem whatever the order or the
  /// threads they were evaluated in.
  std::string message() const;

  /// Of a residual block, by its index: told by its family.
  void Note(int residual, const std::string& error);

 private:
  const ceres::Solver::Options& options_;
  mutable std::mutex mutex_;
  std::map<int, std::string> errors_;
};

}  // namespace inceres::internal
