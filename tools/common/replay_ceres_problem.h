#pragma once

#include <array>
#include <deque>
#include <map>
#include <memory>
#include <vector>

#include <ceres/ordered_groups.h>
#include <ceres/problem.h>

#include "inceres/status.h"
#include "tools/common/replay_step.h"

namespace inceres::tools {

/// A ceres::Problem that grows by the steps of a replay and owns its parameter values.
class ReplayCeresProblem {
 public:
  explicit ReplayCeresProblem(bool autodiff) : autodiff_(autodiff) {}
  ReplayCeresProblem(const ReplayCeresProblem&) = delete;
  ReplayCeresProblem& operator=(const ReplayCeresProblem&) = delete;

  /// kInvalidArgument names the first factor whose shape has no AutoDiff version; the step is then partly added.
  Status Add(const ReplayStep& step);

  ceres::Problem* problem() { return &problem_; }
  /// A copy, as solves need one of their own: landmarks in group 0, frames in group 1, constants and unused variables too.
  std::shared_ptr<ceres::ParameterBlockOrdering> LandmarksFirst() const;

  /// All variables in order of arrival.
  std::vector<double> State() const;
  void SetState(const std::vector<double>& state);

 private:
  ceres::Manifold* ManifoldOf(ReplayVariable::Kind kind);
  ceres::LossFunction* LossOf(double huber);
  ceres::CostFunction* CostOf(const ReplayFactor& factor) const;

  const bool autodiff_;
  std::deque<std::array<double, 9>> values_;  // a deque keeps addresses as it grows
  std::vector<ReplayVariable::Kind> kinds_;
  // The problem owns these; each is made when first used.
  std::map<ReplayVariable::Kind, ceres::Manifold*> manifolds_;
  std::map<double, ceres::LossFunction*> losses_;
  ceres::ParameterBlockOrdering ordering_;
  ceres::Problem problem_;
};

}  // namespace inceres::tools
