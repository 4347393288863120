#include "inceres/ceres/session.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "adapters/ceres/compare/cross_check.h"
#include "adapters/ceres/exact/exact_solve.h"
#include "adapters/ceres/fallback/gate.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/plan/structure_cache.h"
#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/read/selection.h"
#include "adapters/ceres/read/user_state.h"
#include "adapters/ceres/report/summary_writer.h"
#include "adapters/ceres/session/incremental_solve.h"
#include "adapters/ceres/session/mode_choice.h"
#include "adapters/ceres/session/window_watch.h"
#include "src/base/stopwatch.h"
#include "src/incremental/descent_pace.h"

namespace inceres {

namespace {

using internal::ModeChoice;

std::int64_t NumEvaluations(const UpdateSummary& update) {
  return update.num_evaluated_factors + update.num_relinearized_factors;
}

// What the last kPaceIterations have gained; all of it where there were fewer. Costs would tell
// less: next to the fixed one it may be less than their last digit.
double GainedLately(const ceres::Solver::Summary& summary) {
  const auto& iterations = summary.iterations;
  const int num_before =
      std::max(0, static_cast<int>(iterations.size()) - internal::kPaceIterations);
  return std::accumulate(iterations.begin() + num_before, iterations.end(), 0.0,
                         [](double sum, const ceres::IterationSummary& iteration) {
                           return iteration.step_is_successful ? sum + iteration.cost_change : sum;
                         });
}

// Where a solve has ended, without what is fixed.
double MovingCost(const SolveReport& report) {
  return report.update.final_cost;
}

bool IsOnItsWay(const ceres::Solver::Summary& summary, const SolveReport& report,
                int iterations_left) {
  return static_cast<int>(summary.iterations.size()) > internal::kPaceIterations &&
         internal::IsOnItsWay(GainedLately(summary), MovingCost(report), iterations_left);
}

double Tolerance(const internal::SolveInput& input, const SolveReport& report) {
  return input.options.function_tolerance * MovingCost(report);
}

// Whether two ways have come to one place: to the last digits of the cost, which is all that there
// is to tell where the rest of it is rounding, or next to nothing of the tolerance apart.
bool IsSameEnd(double cost, double other, double tolerance) {
  constexpr double kShare = 1e-2;
  constexpr double kDigits = 1e-15;
  return std::fabs(cost - other) <= std::max(kShare * tolerance, kDigits * other);
}

// Of the part of a solve before.
void AddWork(const UpdateSummary& before, UpdateSummary* update) {
  update->num_relinearized_factors += before.num_relinearized_factors;
  update->num_evaluated_factors += before.num_evaluated_factors;
  for (int UpdateSummary::*count :
       {&UpdateSummary::num_iterations, &UpdateSummary::num_batch_iterations,
        &UpdateSummary::num_unsuccessful_steps, &UpdateSummary::num_shortened_steps,
        &UpdateSummary::num_reweighed_factors, &UpdateSummary::num_recentered_factors,
        &UpdateSummary::num_eliminated_landmarks, &UpdateSummary::num_updated_landmarks,
        &UpdateSummary::num_factored_rows, &UpdateSummary::num_reorderings,
        &UpdateSummary::num_solved_rows, &UpdateSummary::num_pcg_iterations,
        &UpdateSummary::num_landmark_refinements, &UpdateSummary::num_visited_landmarks,
        &UpdateSummary::num_moved_frames, &UpdateSummary::num_rebuilds,
        &UpdateSummary::num_drifted_frames}) {
    update->*count += before.*count;
  }
}

// Whether there were iterations from this one on, and no step of theirs could be evaluated: no way
// was gone.
bool AllRefused(const ceres::Solver::Summary& summary, std::size_t first) {
  const auto begin = summary.iterations.begin() + static_cast<std::ptrdiff_t>(first);
  return begin != summary.iterations.end() &&
         std::all_of(begin, summary.iterations.end(), [](const ceres::IterationSummary& row) {
           return row.cost >= std::numeric_limits<double>::max();
         });
}

}  // namespace

class CeresSession::Impl {
 public:
  explicit Impl(const SessionOptions& session_options) : options(session_options) {}

  void Look(const ceres::Problem& problem) {
    if (has_view) {
      internal::IntrospectValues(problem, &view);
    } else {
      internal::Introspect(problem, &view);
    }
    has_view = true;
  }

  // Whether the problem can still have the structure that was looked at.
  bool LooksTheSame(const ceres::Problem& problem) const {
    return problem.NumResidualBlocks() == view.all.num_residual_blocks &&
           problem.NumParameterBlocks() == view.all.num_parameter_blocks &&
           problem.NumResiduals() == view.all.num_residuals;
  }

  void SolveOnce(const internal::SolveCall& given);
  void SolveLiving(const internal::SolveCall& call, const internal::SolveInput& input,
                   IncrementalOptions core, internal::StartValues* start);

  std::string ReasonForExact(const ceres::Solver::Options& solver_options);
  bool IsUnfinished(const internal::SolveInput& input, const IncrementalOptions& core,
                    const SolveReport& report, const ceres::Solver::Summary& summary) const;
  bool Finish(const ceres::Problem& problem, const internal::SolveInput& input,
              const IncrementalOptions& core, const internal::StartValues& start,
              std::unique_ptr<internal::IncrementalProblem>* working, SolveReport* report,
              ceres::Solver::Summary* summary);
  // What came of a part of a solve: nothing, and all is as before it; an end; an abort, or values
  // that cannot be evaluated.
  enum class Part { kNone, kDone, kAborted };
  struct Descent {
    TrustRegionStrategyKind strategy;
    int max_iterations = 0;
    bool as_ceres = false;  // by its iterates, and its rules
    // Unless null what is remembered goes on by itself.
    std::unique_ptr<internal::IncrementalProblem>* working = nullptr;
  };
  Part GoOn(const internal::SolveInput& input, const Descent& descent,
            const internal::StartValues& start, SolveReport* report,
            ceres::Solver::Summary* summary);
  bool SolveExactlyFor(const std::string& reason, const internal::SolveCall& call,
                       internal::SolveInput* input);
  std::unique_ptr<internal::IncrementalProblem> NewLiving(const IncrementalOptions& core);
  bool IsMostlyNew(double num_residual_blocks, double num_known) const {
    return num_residual_blocks - num_known > options.core.batch_share * num_residual_blocks;
  }
  bool RemembersLittle(const IncrementalOptions& core) const;
  void BeginToRemember(const internal::SolveCall& call, const internal::SolveInput& input,
                       const IncrementalOptions& core);

  const SessionOptions options;
  internal::WindowWatch watch;
  internal::ModeChoice choice;
  std::unique_ptr<internal::IncrementalProblem> living;
  bool is_of_last_solve = false;  // the living problem is what the last solve has left
  // Of the living problem, which cannot change them.
  int num_threads = 0;
  ReducedSolverKind reduced_solver = ReducedSolverKind::kAutomatic;
  internal::ProblemView view;
  bool has_view = false;      // of the problem's structure as it is
  int num_moving_before = 0;  // of the last exact solve: residual blocks that touch variable ones
};

void CeresSession::Impl::SolveOnce(const internal::SolveCall& given) {
  const double began = internal::NowInSeconds();
  // Ceres works on a copy, too: a callback may change the caller's options.
  const ceres::Solver::Options own_options = given.options;
  const internal::SolveCall call{own_options, given.problem, given.summary, given.solve_options,
                                 given.report};
  const auto& [solver_options, problem, summary, solve_options, report] = call;
  internal::OrderingView ordering;
  has_view = has_view && LooksTheSame(*problem);
  ceres::EvaluationCallback* const callback =
      internal::EvaluationCallbackOf(*problem, solve_options.evaluation_callback);
  std::string reason;
  const std::string obstacle = internal::FindObstacle(
      solver_options, /*incremental=*/true, callback, [&] { Look(*call.problem); }, view, &ordering,
      &reason);
  if (!obstacle.empty()) {
    internal::Decline(call, obstacle);
    return;
  }
  internal::SolveInput input{solver_options, view, ordering, began, callback, solve_options};
  const bool was_paused = choice.IsPaused();
  if (reason.empty()) {
    reason = ReasonForExact(solver_options);
  }
  // The last of a pause is remembered, for the next solve is to be incremental.
  const bool ends_pause = was_paused && !choice.IsPaused();
  if (!reason.empty() && !ends_pause) {
    SolveExactlyFor(reason, call, &input);
    return;
  }
  const IncrementalOptions core = internal::IncrementalOptionsFor(input, options.core);
  internal::StartValues start(view);
  if (options.automatic && reason.empty() && RemembersLittle(core)) {
    reason = "auto: most of the problem is not remembered";
  }
  if (reason.empty()) {
    SolveLiving(call, input, core, &start);
    return;
  }
  if (SolveExactlyFor(reason, call, &input)) {
    // It calls the user's code after the solve, and an exception may come of that.
    BeginToRemember(call, input, core);
  }
  start.Keep();
}

void CeresSession::Impl::SolveLiving(const internal::SolveCall& call,
                                     const internal::SolveInput& input, IncrementalOptions core,
                                     internal::StartValues* start) {
  choice.TellIfAgain();
  // Out of the session while it works: a failure, or an exception out of user code, ends it.
  std::unique_ptr<internal::IncrementalProblem> working = std::move(living);
  if (working == nullptr || core.num_threads != num_threads ||
      core.reduced_solver != reduced_solver) {
    working = NewLiving(core);
  }
  core.max_num_iterations = std::min(core.max_num_iterations, ModeChoice::kPatience);
  const auto& [solver_options, problem, summary, solve_options, report] = call;
  bool solved = internal::SolveIncrementally(input, core, working.get(), summary, report);
  if (solved) {
    solved = !IsUnfinished(input, core, *report, *summary) ||
             Finish(*problem, input, core, *start, &working, report, summary);
  }
  if (solved && options.automatic) {
    // with what finishing took
    choice.Note(report->update, report->changes, view, report->num_frames,
                options.verify_cached_factors);
  }
  if (solved) {
    start->Keep();
    living = std::move(working);
    // Where there is nothing to solve for it has not followed the problem.
    is_of_last_solve = living != nullptr && view.reduced.num_parameter_blocks > 0;
  }
}

// Whether a solve has ended without convergence that is proven, though no limit of the user's asked
// for it.
bool CeresSession::Impl::IsUnfinished(const internal::SolveInput& input,
                                      const IncrementalOptions& core, const SolveReport& report,
                                      const ceres::Solver::Summary& summary) const {
  const bool has_ended =
      summary.termination_type == ceres::CONVERGENCE && !report.update.rests_on_refusals;
  return !has_ended && summary.IsSolutionUsable() &&
         summary.termination_type != ceres::USER_SUCCESS &&
         (core.batch_share < 1.0 || !internal::IsIterative(input.options.linear_solver_type)) &&
         static_cast<int>(summary.iterations.size()) <= input.options.max_num_iterations &&
         NumEvaluations(report.update) < options.core.max_factor_evaluations &&
         input.Seconds() < input.options.max_solver_time_in_seconds;
}

// The batch solver, or what is remembered, from the values in the user's memory, which shows the
// start again meanwhile, as in a solve of one part. What is remembered finds the values changed.
CeresSession::Impl::Part CeresSession::Impl::GoOn(const internal::SolveInput& input,
                                                  const Descent& descent,
                                                  const internal::StartValues& start,
                                                  SolveReport* report,
                                                  ceres::Solver::Summary* summary) {
  if (NumEvaluations(report->update) >= options.core.max_factor_evaluations) {
    return Part::kNone;
  }
  internal::SolveInput again{
      input.options, view, input.ordering, input.began, /*evaluation_callback=*/nullptr,
      input.asked};
  again.shown = &start;
  again.fixed_cost = summary->fixed_cost;
  again.last_iteration = static_cast<int>(summary->iterations.size()) - 1;
  const bool in_batch = descent.working == nullptr;
  const auto type = internal::TypeToPlanIncrementally(input.options, input.ordering);
  if (in_batch && !internal::ChoosePlan(type, &again).empty()) {
    return Part::kNone;  // no memory for it
  }
  has_view = false;  // the batch solver's graph may take its place
  internal::StartValues reached(view);
  ceres::Solver::Summary first;
  std::swap(first, *summary);
  const SolveReport before = *report;
  IncrementalOptions of_part = internal::IncrementalOptionsFor(again, options.core);
  of_part.max_num_iterations = descent.max_iterations;
  of_part.max_factor_evaluations -= NumEvaluations(before.update);
  if (in_batch) {
    of_part.batch_share = descent.as_ceres ? 0.0 : std::min(of_part.batch_share, 0.5);
    of_part.batch_strategy = descent.strategy;
  }
  internal::IncrementalProblem* const remembered = in_batch ? nullptr : descent.working->get();
  const bool usable = internal::SolveIncrementally(again, of_part, remembered, summary, report);
  if (!usable && !in_batch) {
    descent.working->reset();
  }
  // What was reached stays, unless it is found to have no cost: what is remembered of it is then
  // out of date.
  if (summary->termination_type == ceres::FAILURE && !summary->iterations.empty()) {
    *summary = std::move(first);
    *report = before;
    return Part::kNone;
  }
  reached.Keep();
  internal::Prepend(first, summary);
  report->changes = before.changes;
  report->callback_seconds += before.callback_seconds;
  AddWork(before.update, &report->update);
  const std::string number = std::to_string(*again.last_iteration);
  report->exact_reason = before.exact_reason;
  if (in_batch && before.exact_reason.empty()) {
    report->exact_reason = "incremental steps did not converge: those after iteration " + number +
                           " are the batch solver's";
  } else if (!in_batch && !before.exact_reason.empty()) {
    report->exact_reason += ", up to iteration " + number;
  }
  return summary->IsSolutionUsable() ? Part::kDone : Part::kAborted;
}

// What incremental steps did not finish. Where they have hardly come down lately an end is near,
// and Marquardt's rule goes on from there; with bounds, incremental steps. What is not proven then
// is solved from the start as Ceres would, so that no solve takes many more iterations than there;
// and from the lower one of both ends it goes on, unless that one has been such an end before.
// False after an abort.
bool CeresSession::Impl::Finish(const ceres::Problem& problem, const internal::SolveInput& input,
                                const IncrementalOptions& core, const internal::StartValues& start,
                                std::unique_ptr<internal::IncrementalProblem>* working,
                                SolveReport* report, ceres::Solver::Summary* summary) {
  constexpr TrustRegionStrategyKind kGoOn = TrustRegionStrategyKind::kMarquardt;
  // Clamped steps creep along bounds, and prove nothing there.
  working = internal::HasBounds(view) ? working : nullptr;
  // What has ended by refusals would only say so again.
  const bool goes_on = working == nullptr || !report->update.rests_on_refusals;
  const auto iterations_left = [&] {
    return std::max(
        0, input.options.max_num_iterations - static_cast<int>(summary->iterations.size()) + 1);
  };
  // With too few iterations left to begin anew all of them go on from there.
  if (iterations_left() <= ModeChoice::kPatience) {
    const Descent only{
        IsOnItsWay(*summary, *report, iterations_left()) ? core.batch_strategy : kGoOn,
        iterations_left(), /*as_ceres=*/false, working};
    return !goes_on || GoOn(input, only, start, report, summary) != Part::kAborted;
  }
  bool has_end = !goes_on;  // without a proof
  if (goes_on && GainedLately(*summary) <= Tolerance(input, *report)) {
    const Descent near{kGoOn, iterations_left() / 2, /*as_ceres=*/false, working};
    const int others_left = iterations_left() - near.max_iterations;
    const Part part = GoOn(input, near, start, report, summary);
    if (part != Part::kDone || !IsUnfinished(input, core, *report, *summary)) {
      return part != Part::kAborted;
    }
    has_end = iterations_left() > others_left;
  }
  const ceres::TerminationType termination = summary->termination_type;
  const std::string message = summary->message;
  const bool rests_on_refusals = report->update.rests_on_refusals;
  const double remaining = report->update.remaining_decrease;
  const double lowest = MovingCost(*report);
  const double lowest_of_all = summary->final_cost;
  // Another end next to it is none.
  const double margin = has_end ? Tolerance(input, *report) : 0.0;
  internal::StartValues reached(view);  // there again, unless Ceres's way leads lower
  start.PutBack();
  Look(problem);
  const Descent anew{core.batch_strategy, iterations_left() / 2, /*as_ceres=*/true};
  const std::size_t num_before = summary->iterations.size();
  // The batch solver's own way is Ceres's: going it again proves nothing.
  const bool is_alike = report->update.num_batch_iterations >= report->update.num_iterations;
  const Part part = GoOn(input, anew, start, report, summary);
  if (part == Part::kAborted) {
    return false;
  }
  const bool is_lower = part == Part::kDone && MovingCost(*report) <= lowest - margin;
  const bool ended_by_user = summary->termination_type == ceres::USER_SUCCESS;
  // Two ways that are not alike have come to the same place, and Ceres calls it converged.
  const bool is_same = part == Part::kDone && summary->termination_type == ceres::CONVERGENCE &&
                       !is_alike && !AllRefused(*summary, num_before) &&
                       IsSameEnd(MovingCost(*report), lowest, Tolerance(input, *report));
  if (!is_lower) {
    reached.PutBack();
    summary->final_cost = report->core.final_cost = lowest_of_all;
    report->update.final_cost = lowest;
    if (!ended_by_user && !is_same) {
      summary->message = message;
      summary->termination_type = termination;
      report->update.rests_on_refusals = rests_on_refusals;
      report->update.remaining_decrease = remaining;
    }
  }
  reached.Keep();
  if (ended_by_user || is_same || part == Part::kNone || (has_end && !is_lower)) {
    return true;
  }
  Look(problem);
  const Descent last{kGoOn, iterations_left(), /*as_ceres=*/false, working};
  return GoOn(input, last, start, report, summary) != Part::kAborted;
}

// Empty: the solve is to be incremental.
std::string CeresSession::Impl::ReasonForExact(const ceres::Solver::Options& solver_options) {
  if (internal::IsIterative(solver_options.linear_solver_type)) {
    return "";
  }
  if (options.exact_windows && watch.WantsExact(view)) {
    return "a window slides, or may: what a solve leaves undone would become final";
  }
  return options.automatic && choice.WantsExact() ? choice.reason() : "";
}

// What was remembered is out of date then, and takes memory. False if it was declined: what exact
// mode cannot do was not asked for a solve that was to be incremental.
bool CeresSession::Impl::SolveExactlyFor(const std::string& reason, const internal::SolveCall& call,
                                         internal::SolveInput* input) {
  living.reset();
  has_view = false;  // an exact solve empties it
  std::string obstacle = internal::OptionsObstacle(input->options);
  if (obstacle.empty()) {
    obstacle = internal::DenseQrObstacle(input->options, input->view, input->ordering);
  }
  if (obstacle.empty()) {
    obstacle =
        internal::ChoosePlan(internal::TypeToPlanFor(input->options, input->ordering), input);
  }
  if (!obstacle.empty()) {
    internal::Decline(call, obstacle);
    return false;
  }
  // Told by their number: where as many have gone as have come, all of them are taken for known.
  const int num_moving = input->view.reduced.num_residual_blocks;
  const bool mostly_new = IsMostlyNew(num_moving, std::exchange(num_moving_before, num_moving));
  internal::SolveExactly(*input, call.summary, call.report);
  call.report->exact_reason = reason;
  choice.NoteExact(*call.summary, mostly_new);
  return true;
}

std::unique_ptr<internal::IncrementalProblem> CeresSession::Impl::NewLiving(
    const IncrementalOptions& core) {
  num_threads = core.num_threads;
  reduced_solver = core.reduced_solver;
  const auto trust =
      options.verify_cached_factors ? internal::Trust::kVerified : internal::Trust::kAddresses;
  return std::make_unique<internal::IncrementalProblem>(core, trust);
}

// Whether the batch solver would have most of the solve: then it is exact mode's from beginning to
// end.
bool CeresSession::Impl::RemembersLittle(const IncrementalOptions& core) const {
  return core.batch_share > 0.0 && core.batch_share < 1.0 &&
         IsMostlyNew(view.reduced.num_residual_blocks,
                     living != nullptr ? living->num_factors() : 0);
}

// Where an exact solve has ended, if what the next ones change is likely to be little.
void CeresSession::Impl::BeginToRemember(const internal::SolveCall& call,
                                         const internal::SolveInput& input,
                                         const IncrementalOptions& core) {
  if (!choice.IsToRemember()) {
    return;
  }
  Look(*call.problem);
  std::unique_ptr<internal::IncrementalProblem> beginning = NewLiving(core);
  if (internal::LinearizeOnly(input, core, beginning.get())) {
    living = std::move(beginning);
    is_of_last_solve = true;
  }
}

CeresSession::CeresSession(const SessionOptions& options) : impl_(std::make_unique<Impl>(options)) {
}

CeresSession::~CeresSession() = default;

void CeresSession::Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
                         ceres::Solver::Summary* summary, const SolveOptions& solve_options,
                         SolveReport* report) {
  SolveOptions incremental = solve_options;
  incremental.mode = SolveMode::kIncremental;
  // Whatever comes before SolveOnce, an exception of stock's too: the edits are not told again.
  impl_->has_view = impl_->has_view && solve_options.problem_unedited;
  impl_->is_of_last_solve = false;
  internal::SolveAsAsked(
      {options, problem, summary, incremental, report},
      [this](const internal::SolveCall& call) { impl_->SolveOnce(call); },
      internal::Repeatable::kNo);
}

Status CeresSession::Covariance(const std::vector<const double*>& parameter_blocks,
                                const LiveCovarianceOptions& options,
                                LiveCovariance* covariance) const {
  *covariance = LiveCovariance();
  return impl_->is_of_last_solve
             ? impl_->living->Covariance(parameter_blocks, options, covariance)
             : Status::Error(StatusCode::kInvalidArgument,
                             "nothing is left of the last solve: it was exact, went to stock "
                             "Ceres, was refused, failed or had nothing to solve for, or there was "
                             "none");
}

void internal::SolveOnceInSession(const SolveCall& call) {
  SessionOptions options;
  options.exact_windows = false;  // no window slides in one solve
  CeresSession::Impl(options).SolveOnce(call);
}

void CeresSession::Forget(const ceres::CostFunction* cost_function) {
  if (impl_->living != nullptr) {
    impl_->living->Forget(cost_function);
  }
}

void CeresSession::Forget(const ceres::LossFunction* loss_function) {
  if (impl_->living != nullptr) {
    impl_->living->Forget(loss_function);
  }
}

void CeresSession::Reset() {
  impl_->living.reset();
  impl_->is_of_last_solve = false;
  impl_->has_view = false;
  impl_->watch = internal::WindowWatch();
  impl_->choice = internal::ModeChoice();
}

}  // namespace inceres
