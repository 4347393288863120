#pragma once

#include <memory>
#include <vector>

#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_evaluation.h"
#include "trust_region/loop_options.h"
#include "trust_region/step_trial.h"
#include "trust_region/strategy.h"

namespace inceres::internal {

/// The linear solve of an iteration of the trust-region loop: the strategy's step, counted and
/// timed, shown to who looks at linear systems, and refused where its model promises nothing.
class StepSolve {
 public:
  /// The strategy may be made later. All of them outlive this.
  StepSolve(const SolverOptions& options, const LoopOptions& loop, LoopEvaluation* evaluation,
            LinearModel* model, const std::unique_ptr<TrustRegionStrategy>* strategy,
            StepTrial* trial, Summary* summary)
      : options_(options),
        loop_(loop),
        evaluation_(*evaluation),
        model_(*model),
        strategy_(*strategy),
        trial_(*trial),
        summary_(*summary) {}

  /// Writes the trial's step, found with columns of this scale. Whether it is valid the iteration
  /// tells. False: the solve has ended, for reasons that have nothing to do with numbers.
  bool Run(const std::vector<double>& scale, IterationSummary* iteration);
  /// After a step that is not valid. False: it was one too many in a row, and the solve has ended.
  bool GoOnWithout();

  /// Steps that were not valid, since the last one that was.
  int num_invalid() const { return num_invalid_; }
  void set_num_invalid(int num_invalid) { num_invalid_ = num_invalid; }

 private:
  void Count(int num_solves, IterationSummary* iteration);
  void ShowSystem(const std::vector<double>& scale, int iteration) const;

  const SolverOptions& options_;
  const LoopOptions& loop_;
  LoopEvaluation& evaluation_;
  LinearModel& model_;
  const std::unique_ptr<TrustRegionStrategy>& strategy_;
  StepTrial& trial_;
  Summary& summary_;
  int num_invalid_ = 0;
  int num_empty_ = 0;  // of these, with a step that promises nothing
};

}  // namespace inceres::internal
