#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/stopwatch.h"
#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "linearize/evaluator.h"
#include "trust_region/agreement.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_options.h"
#include "trust_region/strategy.h"

namespace inceres::internal {

/// Entries of the state that follow each other.
struct StateRun {
  std::int64_t begin;
  std::int64_t end;
};

/// What a minimizer works in. Handed on to the next one of the same sizes, which then asks for no
/// memory.
struct TrustRegionMemory {
  std::vector<double> scale;
  std::vector<double> best_state;
  std::vector<double> step;
  std::vector<double> scaled_step;
  std::vector<StateRun> runs;  // what moves and is counted here, in the order of the variables
  std::unique_ptr<TrustRegionStrategy> strategy;
};

/// What all parts of the loop of one solve work with. All of it outlives them.
struct LoopParts {
  const SolverOptions& options;
  const LoopOptions& loop;
  Evaluator& evaluator;
  LinearModel& model;
  TrustRegionMemory& memory;
  StageClock& clock;
  Summary& summary;
};

/// What the trust-region loop asks of the cost: observers hear of each evaluation before it is
/// made, all processes agree on what came of it, and the summary has its count and time, and the
/// first candidate that could not be evaluated.
class LoopEvaluation {
 public:
  /// All processes make theirs at once.
  explicit LoopEvaluation(const LoopParts& parts);
  LoopEvaluation(const LoopEvaluation&) = delete;
  LoopEvaluation& operator=(const LoopEvaluation&) = delete;

  const Agreement& agreement() const { return agreement_; }

  /// The candidate is where this step leads from the current point; false: nowhere.
  bool MoveCandidate(const std::vector<double>& step);
  /// The same, and what it costs there; false if that cannot be evaluated.
  bool CandidateCost(double* cost);
  /// Jacobians and cost at the current point; false, with the reason in the summary's detail.
  /// `new_point`: no cost has been asked for there.
  bool Jacobians(bool new_point, double* cost);
  /// A step was refused. True if its model had less curvature for losses with ρ'' < 0: Jacobians
  /// are those of Ceres's model from now on, and to be evaluated. Without that "steps of all
  /// lengths are refused" would be true of one model only.
  bool TakesCurvatureBack();

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

  const LoopParts& parts_;
  const Agreement alone_;
  const Agreement& agreement_;
  const bool has_observers_;  // in any process
};

}  // namespace inceres::internal
