#pragma once

#include <functional>
#include <utility>
#include <vector>

#include <ceres/evaluation_callback.h>
#include <ceres/solver.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "inceres/solver/solver.h"

namespace inceres::internal {

/// What of the options is asked again and again during a solve: a copy, as Ceres takes one, for a
/// callback may change the user's.
struct ReportOptions {
  explicit ReportOptions(const ceres::Solver::Options& options)
      : callbacks(options.callbacks),
        update_state(options.update_state_every_iteration),
        logs(options.logging_type != ceres::SILENT),
        to_stdout(options.minimizer_progress_to_stdout),
        eta(options.eta) {}

  std::vector<ceres::IterationCallback*> callbacks;
  bool update_state;
  bool logs;
  bool to_stdout;
  double eta;
};

/// What Ceres does at the end of an iteration once the user's memory is as it is to be: log the
/// progress row (unless silent), call the user's callbacks until one of them stops the solve. Adds
/// the seconds these took to `*callback_seconds`.
ObserverAction ReportIteration(const ReportOptions& options, const IterationSummary& iteration,
                               double* callback_seconds);

/// What Ceres does at the end of an iteration, in its order: copy the best state to the user's
/// memory (if asked to), then ReportIteration. And, if the problem has an evaluation callback,
/// before an evaluation: copy the point to the user's memory and call it.
class CallbackObserver : public SolveObserver {
 public:
  /// Borrows all for the length of a solve; `evaluation_callback` may be null. `fixed_cost` is
  /// of residual blocks that are not in the graph.
  CallbackObserver(const ceres::Solver::Options& options,
                   ceres::EvaluationCallback* evaluation_callback,
                   const std::vector<StateBlock>& blocks, double fixed_cost)
      : options_(options),
        evaluation_callback_(evaluation_callback),
        blocks_(blocks),
        fixed_cost_(fixed_cost) {}

  /// Asked after all callbacks of an iteration: whether to abort. May be empty.
  void set_is_to_abort(std::function<bool()> is_to_abort) { is_to_abort_ = std::move(is_to_abort); }

  /// False if nobody would notice that the solve goes on without it.
  bool IsNeeded() const;

  void BeforeEvaluation(const double* state, bool jacobians, bool new_point) override;
  ObserverAction EndOfIteration(const IterationSummary& iteration,
                                const double* best_state) override;

  /// Spent in the user's iteration callbacks so far.
  double callback_seconds() const { return callback_seconds_; }

 private:
  const ReportOptions options_;
  ceres::EvaluationCallback* const evaluation_callback_;
  const std::vector<StateBlock>& blocks_;
  const double fixed_cost_;
  std::function<bool()> is_to_abort_;
  double callback_seconds_ = 0.0;
};

}  // namespace inceres::internal
