#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <string>

#include "inceres/problem/factor_graph.h"
#include "inceres/solver/callbacks.h"
#include "inceres/solver/incremental_options.h"
#include "inceres/solver/solver.h"
#include "incremental/descent_pace.h"
#include "incremental/stagnation.h"
#include "incremental/tuning.h"
#include "incremental/update_trace.h"
#include "trust_region/loop_options.h"
#include "trust_region/strategy.h"

namespace inceres::internal {

/// What comes after the batch solver: the incremental one, which finishes, or nothing.
enum class BatchEnd { kHandsOver, kToTheEnd };

/// A call of the batch solver, from the graph's state on.
struct BatchCall {
  const IncrementalOptions* options;
  const Tuning::Batch& tuning;
  BatchEnd end;
  const std::atomic<bool>& stop;
  Solver* solver;  // may have served before
  FactorGraph* graph;
  /// *shown_state is the best state so far while the trace's observer is called, laid out as the
  /// graph's, otherwise null.
  const double** shown_state;
  UpdateTrace* trace;
};

/// What a cost may change by without counting.
inline double ToleranceAt(double cost, const IncrementalOptions& options) {
  return options.function_tolerance * std::max(cost - options.fixed_cost, 0.0);
}

/// Counts the work of the batch solver, writes the trace, and ends the solve when the Update's
/// observer says so, on request, when the work budget is spent, and, before one more step proves
/// it, where what is left is below the tolerance: good steps gain so fast less, or the next one
/// promises too little (docs/algorithms.md, "One-time solves and exact windows").
class BatchObserver final : public SolveObserver, public StepJudge {
 public:
  explicit BatchObserver(const BatchCall& call)
      : call_(call),
        options_(*call.options),
        tuning_(call.tuning),
        trace_(*call.trace),
        stagnation_(call.tuning) {}
  ~BatchObserver() override { *call_.shown_state = nullptr; }
  BatchObserver(const BatchObserver&) = delete;
  BatchObserver& operator=(const BatchObserver&) = delete;

  void BeforeEvaluation(const double* state, bool jacobians, bool new_point) override;
  bool IsWorthTrying(const IterationSummary& iteration, const StepOrigin& origin) override;
  bool IsLast(const IterationSummary& iteration) override;
  /// A step that is short for its damping is no sign of a minimum.
  bool MayEndByTolerance() override {
    return options_.batch_share == 0.0 || !IsByMarquardt() || tried_radius_ >= tuning_.proof_radius;
  }
  bool TakesBack() override { return options_.batch_share > 0.0; }
  double RestartRadius() override { return stagnation_.TakeRestartRadius(); }
  bool HoldsRefusing() override { return hold_.on; }
  double MostColumnNorm() override { return TakesBack() ? tuning_.most_column_norm : HUGE_VAL; }
  double LeastRadius() override {
    return is_near_ && steps_to_wait_ == 0 ? tuning_.seeing_radius : 0.0;
  }
  ObserverAction EndOfIteration(const IterationSummary& iteration,
                                const double* best_state) override;

  bool ended_by_user() const { return ended_by_user_; }
  bool settled() const { return settled_; }
  /// What that rests on, where it is not what the model sees left.
  const std::string& words() const { return words_; }
  /// Steps have brought next to nothing, but for want of any that is damped by little: an end, and
  /// no minimum that is proven.
  bool stagnates() const { return stagnates_; }
  /// Of the best state, where Ceres reports the lowest cost seen, refused steps included.
  double cost() const { return best_cost_; }
  /// Whether the model, which sees all directions, promises next to nothing: that is what Ceres's
  /// rule means to say, by which the last step would have changed the cost by so little. Where the
  /// step does not keep even that, the cost is less curved than the model, or more.
  bool PromisesNothing(double change) const { return promises_nothing_ && IsBorneOut(change); }
  /// The same of the directions that its damping lets it see. 0: there was no such step.
  bool PromisesLittle(double cost_change) const {
    return last_promise_ <= Tolerance(cost_) && (cost_change == 0.0 || IsBorneOut(cost_change));
  }
  /// Whether steps with less damping than the last one, where such were refused lately, would gain
  /// little more: down to where they are refused.
  bool HidesLittle() const { return steps_to_wait_ == 0 || HoldsLittleBack(TimesMore()); }
  /// Whether a step was refused so lately that a Dog-Leg's radius is still what that has made it.
  bool refused_lately() const { return num_accepted_in_row_ < kAcceptedInRow; }
  /// What the last step and those to come promise, where they are not taken; -1: it is not known.
  double rest() const { return rest_; }

 private:
  // Steps taken one after another, after which a Dog-Leg's radius is no longer what a refusal has
  // made it.
  static constexpr int kAcceptedInRow = 2;

  void NoteIteration(const IterationSummary& iteration);
  void WaitAfterRefusal(const IterationSummary& iteration);
  double Tolerance(double cost) const { return ToleranceAt(cost, options_); }
  // Along a direction that is less curved than the model, or a saddle, a step gains more; of what
  // was promised no more than that can have been there. Where another solver goes on little is lost
  // by doubt.
  bool KeepsPromise(double gain, double promise) const {
    const bool is_last = call_.end == BatchEnd::kToTheEnd;
    const double error = is_last ? 1.0 - tuning_.kept_promise : tuning_.trial_error;
    return std::fabs(gain - promise) <= error * promise;
  }
  // By a last step that was not taken, and would have changed the cost by so much.
  bool IsBorneOut(double cost_change) const {
    return last_promise_ <= tuning_.no_gain_share * Tolerance(cost_) ||
           KeepsPromise(cost_change, last_promise_);
  }
  bool IsByMarquardt() const {
    return options_.batch_strategy == TrustRegionStrategyKind::kMarquardt;
  }
  // What may be left undone: next to nothing where convergence was slow, for what gains and
  // promises foretell has been wrong there.
  double Allowed(double cost) const {
    return (IsByMarquardt() ? tuning_.proof_share : tuning_.settled_share) * Tolerance(cost);
  }
  // Whether Levenberg–Marquardt's damping is small enough not to hide what weak directions could
  // gain; of a Dog-Leg, whether no refusal has shrunk its radius lately.
  bool SeesAll() const { return HoldsLittleBack(1.0) && IsHardlyDamped(); }
  bool IsHardlyDamped() const {
    return IsDamped(options_.batch_strategy) ? tried_radius_ >= tuning_.seeing_radius
                                             : !refused_lately();
  }
  // The same, or where steps with so little damping were refused lately, or others stagnate, with a
  // bit more: what that holds back of a weak direction, steps would gain as many times over whose
  // damping is that many times less, down to where they are refused.
  bool SeesEnough() const {
    return SeesAll() || (IsByMarquardt() && tried_radius_ >= tuning_.proof_radius &&
                         HoldsLittleBack(TimesMore()) &&
                         (steps_to_wait_ > 0 || stagnation_.is_proving() || hold_.on));
  }
  double TimesMore() const {
    const double widest = std::min(tuning_.seeing_radius, tuning_.refused_share * refused_radius_);
    return std::max(1.0, widest / tried_radius_);
  }
  bool HoldsLittleBack(double times) const {
    return times * held_back_ <= tuning_.held_back_share * Tolerance(cost_);
  }
  bool HasStagnated(const IterationSummary& iteration);
  void BeginHold(Stagnation::Verdict verdict);
  bool IsWorthHolding(const IterationSummary& iteration) const;
  void EndHold();
  bool IsRefusedForNothing(const IterationSummary& iteration) const;
  bool HasJustSettled(const IterationSummary& iteration);
  bool HasSpentBudget() const;
  bool IsOutOfPatience(const IterationSummary& iteration) const;
  void WriteRow(const IterationSummary& iteration);

  const BatchCall call_;
  const IncrementalOptions& options_;
  const Tuning::Batch& tuning_;
  UpdateTrace& trace_;
  double cost_ = 0.0;       // of the state
  double best_cost_ = 0.0;  // of a state there was, since the cost became another function
  DescentPace pace_;
  double previous_gain_ = 0.0;  // 0, of no use, gives no ratio
  double previous_ratio_ = HUGE_VAL;
  double last_promise_ = HUGE_VAL;
  double tried_radius_ = 0.0;         // of the step under judgment
  double refused_radius_ = HUGE_VAL;  // of the last step that was refused
  double held_back_ = 0.0;            // of the one under judgment, by its damping
  bool within_rounding_ = false;      // all of it is
  double last_ratio_ = 0.0;
  double rest_ = 0.0;
  std::string words_;
  int last_judged_ = -1;
  bool ended_by_user_ = false;
  int steps_to_wait_ = 0;     // before a step is hardly damped again
  int wait_ = 2;              // after the next refusal of one
  bool is_near_ = false;      // the last step kept its promise, and gained few tolerances
  bool tries_claim_ = false;  // by the step under judgment
  bool settled_ = false;
  bool stagnates_ = false;
  bool promises_nothing_ = false;
  int num_accepted_in_row_ = kAcceptedInRow;
  Stagnation stagnation_;
  int num_refusing_ = 0;  // degrees of freedom of the variables at a border
  // The variables that a border has stopped stand still while the others go on.
  struct Hold {
    bool on = false;
    bool is_over = false;  // the others are at their minimum
    bool is_near = false;  // the last time they gained no more than the tolerance
    bool proves = false;   // steps of all lengths were refused before
    double from_cost = 0.0;
  } hold_;
};

}  // namespace inceres::internal
