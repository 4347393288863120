#include "adapters/ceres/dropin/src/dropin_solve.h"

#include <memory>
#include <string>
#include <utility>

#include <glog/logging.h>

#include "adapters/ceres/compare/cross_check.h"
#include "adapters/ceres/dropin/src/ceres_symbols.h"
#include "adapters/ceres/fallback/gate.h"
#include "adapters/ceres/report/environment.h"
#include "adapters/ceres/session/window_watch.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"

namespace inceres::internal {

// The adapter's way to stock Ceres, in the drop-in: past our own ceres::Solver::Solve to the member
// function behind it. The next *free* ceres::Solve would come back to us, for it calls the member
// by way of the dynamic linker.
void SolveWithStock(const ceres::Solver::Options& options, ceres::Problem* problem,
                    ceres::Solver::Summary* summary) {
  ceres::Solver solver;
  Next().SolverSolve(&solver, options, problem, summary);
}

namespace {

// A session in use by one solve at a time: a cost function may solve the Problem it is evaluated
// for, however odd that is.
class Borrowed {
 public:
  explicit Borrowed(KnownProblem* known) : known_(known), mine_(!known->busy.exchange(true)) {}
  ~Borrowed() {
    if (mine_) {
      known_->busy = false;
    }
  }
  Borrowed(const Borrowed&) = delete;
  Borrowed& operator=(const Borrowed&) = delete;
  bool mine() const { return mine_; }

 private:
  KnownProblem* known_;
  bool mine_;
};

SolveOptions Asked(const KnownProblem& known, SolveMode mode) {
  SolveOptions options = OptionsFromEnvironment();
  options.mode = mode;
  options.evaluation_callback = known.evaluation_callback;
  options.problem_has_no_bounds = Next().sees_all_calls && !known.has_bounds;
  return options;
}

// Which residual blocks are new is known from the calls that added them, whatever their addresses:
// their cost functions are forgotten, so that a residual block removed and added again is
// linearized anew even where nothing that can be evaluated differs: estimators make new cost
// functions where old ones stood, or change one between its removal and its return. And where no
// call has edited the problem, it is not looked through again.
//
// What no wrapped call tells is believed no more than in any CeresSession: the values of parameters
// are compared, and the cost function of a residual block that stayed must still evaluate to its
// residual, bit by bit. For it may have changed where it stands, by memory of its own or of the
// user's that is no argument of it, and neither is an edit of the Problem.
void TellWhatIsNew(KnownProblem* known) {
  if (known->session != nullptr) {
    for (const ceres::CostFunction* cost : known->added_cost_functions) {
      known->session->Forget(cost);
    }
  }
  known->added_cost_functions.clear();
}

CeresSession& SessionOf(DropinMode mode, KnownProblem* known) {
  if (known->session == nullptr) {
    SessionOptions session_options;
    session_options.automatic = mode == DropinMode::kAuto;
    session_options.exact_windows = TheEnvironment().exact_windows;
    known->session = std::make_unique<CeresSession>(session_options);
    known->edited = true;  // everything is new to it
  }
  return *known->session;
}

// A Problem's first solve needs no session: many Problems are solved once, on a stack. The second
// begins one.
void SolveIncrementally(DropinMode mode, KnownProblem* known, const ceres::Solver::Options& options,
                        ceres::Problem* problem, ceres::Solver::Summary* summary) {
  const Borrowed borrowed(known);
  SolveOptions asked = Asked(*known, SolveMode::kIncremental);
  SolveReport report;
  // With bounds only a session brings what incremental steps do not finish to an end.
  if ((known->num_solves > 0 || known->has_bounds) && borrowed.mine()) {
    CeresSession& session = SessionOf(mode, known);
    asked.problem_unedited = Next().sees_all_calls && !known->edited;
    known->edited = false;
    session.Solve(options, problem, summary, asked, &report);
  } else {
    inceres::Solve(options, problem, summary, asked, &report);
  }
  if (report.used_stock) {
    return;
  }
  TheRegistry().CountSolve();
  if (!report.exact_reason.empty()) {
    LOG_FIRST_N(INFO, 1) << "inceres: exact, though asked to be incremental: "
                         << report.exact_reason << " (said once).";
    VLOG(1) << "inceres: exact: " << report.exact_reason;
    return;
  }
  const ProblemChanges& changes = report.changes;
  VLOG(1) << "inceres: incremental: " << changes.num_added_factors << " residual blocks new, "
          << changes.num_removed_factors << " removed, " << changes.num_replaced_factors
          << " not recognized, " << changes.num_kept_factors << " kept; "
          << changes.num_revalued_variables << " parameter blocks revalued; "
          << report.update.num_relinearized_factors << " linearized in "
          << report.update.num_iterations << " iterations.";
}

// A Problem's first solve, of a window's size: exact, as those of a session would be
// (SessionOptions::exact_windows), and without one, for a window may be built anew for every frame.
bool IsFirstOfWindow(const KnownProblem& known, const ceres::Solver::Options& options,
                     const ceres::Problem& problem) {
  return TheEnvironment().exact_windows && known.num_solves == 0 &&
         !IsIterative(options.linear_solver_type) && IsOfWindowSize(problem);
}

void SolveKnown(DropinMode mode, KnownProblem* known, const ceres::Solver::Options& options,
                ceres::Problem* problem, ceres::Solver::Summary* summary) {
  TellWhatIsNew(known);
  if (mode != DropinMode::kExact && !IsFirstOfWindow(*known, options, *problem)) {
    SolveIncrementally(mode, known, options, problem, summary);
    return;
  }
  SolveReport report;
  inceres::Solve(options, problem, summary, Asked(*known, SolveMode::kExact), &report);
  if (!report.used_stock) {
    TheRegistry().CountSolve();
  }
}

void HandOver(const ceres::Solver::Options& options, ceres::Problem* problem,
              ceres::Solver::Summary* summary, const std::string& reason) {
  SolveOptions asked = OptionsFromEnvironment();
  asked.mode = SolveMode::kExact;
  SolveAsAsked(
      {options, problem, summary, asked, nullptr},
      [&reason](const SolveCall& call) { Decline(call, reason); }, Repeatable::kNo, reason);
}

}  // namespace

void SolveInsteadOfCeres(const Environment& environment, KnownProblem* known,
                         const ceres::Solver::Options& options, ceres::Problem* problem,
                         ceres::Solver::Summary* summary) {
  LOG_FIRST_N(INFO, 1) << "inceres: the drop-in solves for Ceres, mode "
                       << ModeName(environment.mode) << ".";
  CHECK(problem != nullptr);  // as ceres::Solve
  CHECK(summary != nullptr);
  if (known == nullptr) {
    HandOver(options, problem, summary,
             "the problem's constructor was not seen, so it may have an evaluation callback");
    return;
  }
  if (environment.mode == DropinMode::kFallback) {
    const std::string obstacle =
        FindObstacle(options, /*incremental=*/false, known->evaluation_callback, *problem);
    HandOver(options, problem, summary, obstacle.empty() ? "INCERES_MODE is fallback" : obstacle);
    return;
  }
  SolveKnown(environment.mode, known, options, problem, summary);
  ++known->num_solves;
}

}  // namespace inceres::internal
