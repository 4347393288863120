#pragma once

#include <array>
#include <deque>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include <ceres/ordered_groups.h>
#include <ceres/problem.h>

#include "inceres/status.h"
#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// A ceres::Problem that grows by the steps of a replay.
class ReplayCeresProblem {
 public:
  /// Owns the values of the variables or, with `storage`, puts them there, one variable after the
  /// other: room for all, which must outlive the problem.
  explicit ReplayCeresProblem(bool autodiff, double* storage = nullptr)
      : autodiff_(autodiff), storage_(storage) {}
  ReplayCeresProblem(const ReplayCeresProblem&) = delete;
  ReplayCeresProblem& operator=(const ReplayCeresProblem&) = delete;

  /// kInvalidArgument names the first factor that has no AutoDiff version; the step is then partly
  /// added.
  Status Add(const ReplayStep& step);

  ceres::Problem* problem() { return problem_.get(); }
  /// The problem of a script that is complete, together with what it needs but for the values.
  std::unique_ptr<ceres::Problem> TakeProblem() { return std::move(problem_); }
  /// A copy, as solves need one of their own: landmarks in group 0, frames in group 1, constants
  /// and unused variables too.
  std::shared_ptr<ceres::ParameterBlockOrdering> LandmarksFirst() const;

  /// All variables in order of arrival.
  std::vector<double> State() const;
  void SetState(const std::vector<double>& state);

 private:
  double* Place(ReplayVariable::Kind kind, const double* start);
  ceres::Manifold* ManifoldOf(ReplayVariable::Kind kind);
  ceres::LossFunction* LossOf(const LossSpec& spec);
  ceres::CostFunction* CostOf(const ReplayFactor& factor) const;

  const bool autodiff_;
  double* storage_;                          // where the next variable goes; null: to owned_
  std::deque<std::array<double, 9>> owned_;  // a deque keeps addresses as it grows
  std::vector<double*> values_;              // of each variable
  std::vector<ReplayVariable::Kind> kinds_;
  // The problem owns these; each is made when first used.
  std::map<ReplayVariable::Kind, ceres::Manifold*> manifolds_;
  std::map<LossSpec, ceres::LossFunction*> losses_;
  ceres::ParameterBlockOrdering ordering_;
  std::unique_ptr<ceres::Problem> problem_ = std::make_unique<ceres::Problem>();
};

}  // namespace inceres::tools
