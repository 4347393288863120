#pragma once

#include <cstdint>
#include <vector>

#include "base/stopwatch.h"
#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "linearize/evaluator.h"
#include "trust_region/agreement.h"
#include "trust_region/loop_options.h"

namespace inceres::internal {

/// Entries of the state that follow each other.
struct StateRun {
  std::int64_t begin;
  std::int64_t end;
};

/// What the trust-region loop asks of the cost: observers hear of each evaluation before it is
/// made, all processes agree on what came of it, and the summary has its count and time, and the
/// first candidate that could not be evaluated.
class LoopEvaluation {
 public:
  /// All of them outlive this. `runs` is memory that it fills. All processes make theirs at once.
  LoopEvaluation(const SolverOptions& options, const LoopOptions& loop, Evaluator* evaluator,
                 std::vector<StateRun>* runs, StageClock* clock, Summary* summary);
  LoopEvaluation(const LoopEvaluation&) = delete;
  LoopEvaluation& operator=(const LoopEvaluation&) = delete;

  Evaluator& evaluator() { return evaluator_; }
  const Evaluator& evaluator() const { return evaluator_; }
  const Agreement& agreement() const { return agreement_; }
  StageClock& clock() { return clock_; }

  /// The candidate is where this step leads from the current point; false: nowhere.
  bool MoveCandidate(const std::vector<double>& step);
  /// The same, and what it costs there; false if that cannot be evaluated.
  bool CandidateCost(double* cost);
  /// Jacobians and cost at the current point; false, with the reason in the summary's detail.
  /// `new_point`: no cost has been asked for there.
  bool Jacobians(bool new_point, double* cost);

  /// Factors move their expansion points to the current point; how many have, in all processes.
  int Recenter();

  /// ‖x‖₂ of the variables that move.
  double StateNorm() const;
  /// ‖candidate − x‖₂ over these, and the largest difference unless null.
  double CandidateDistance(double* max_norm) const;

 private:
  Status ComputeTangents(bool candidate) const;
  void TellObservers(bool jacobians, bool new_point) const;
  bool IsUsable(double cost) const;
  void FindRuns();

  const SolverOptions& options_;
  const LoopOptions& loop_;
  Evaluator& evaluator_;
  StageClock& clock_;
  Summary& summary_;
  const Agreement alone_;
  const Agreement& agreement_;
  const bool has_observers_;     // in any process
  std::vector<StateRun>& runs_;  // what moves and is counted here, in the order of the variables
};

}  // namespace inceres::internal
