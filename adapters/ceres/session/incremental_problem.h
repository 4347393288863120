#pragma once

#include <cstddef>
#include <string>
#include <unordered_set>
#include <vector>

#include "adapters/ceres/read/ceres_adapters.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/session/variable_matching.h"
#include "inceres/ceres/solve.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_solver.h"

namespace inceres::internal {

/// An IncrementalSolver that follows a ceres::Problem: it knows which variable stands for which
/// parameter block, which factor for which residual block, and turns what has changed into one
/// edit. (The rules of recognition are in inceres/ceres/session.h.)
///
/// In the graph are the residual blocks that touch a variable block, and those that did so once and
/// have since become constant.
class IncrementalProblem {
 public:
  IncrementalProblem(const IncrementalOptions& options, Trust trust)
      : solver_(options), edit_(solver_.graph()), trust_(trust) {
    solver_.SetVariableNames([this](VariableId id) { return NameOf(id); });
  }
  IncrementalProblem(const IncrementalProblem&) = delete;
  IncrementalProblem& operator=(const IncrementalProblem&) = delete;

  /// Brings the solver's graph to where the problem is. After an error the object is of no more
  /// use.
  Status Follow(const ProblemNow& now, ProblemChanges* changes);
  IncrementalSolver& solver() { return solver_; }
  /// Of the problem last followed.
  int num_factors() const { return static_cast<int>(known_.factors.size()); }
  /// Current number of variable landmarks of the problem.
  int num_landmarks() const { return num_landmarks_; }

  /// user memory := what the solver found, for the blocks it moves.
  void WriteToUser(const ProblemView& view) const;
  /// CeresSession::Covariance, of the problem last followed.
  Status Covariance(const std::vector<const double*>& parameter_blocks,
                    const LiveCovarianceOptions& options, LiveCovariance* covariance) const;
  /// After a successful Update: takes the proofs by which Follow will recognize what it meets
  /// again.
  void Remember();

  void Forget(const ceres::CostFunction* cost) { forgotten_.insert(cost); }
  void Forget(const ceres::LossFunction* loss) { losses_.Forget(loss); }

 private:
  std::string NameOf(VariableId id) const;

  IncrementalSolver solver_;
  GraphEdit edit_;  // of Follow, which uses its memory again
  const Trust trust_;
  LossTable losses_;
  std::unordered_set<const ceres::CostFunction*> forgotten_;
  Correspondence known_;  // of the problem last followed
  int num_landmarks_ = 0;
};

}  // namespace inceres::internal
