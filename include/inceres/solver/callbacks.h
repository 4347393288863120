#pragma once

#include <functional>
#include <iosfwd>
#include <string>

#include "inceres/export.h"

namespace inceres {

struct IterationSummary;
struct UpdateIteration;

/// What an observer or a callback wants after an iteration.
enum class ObserverAction {
  kContinue,               ///< go on
  kTerminateSuccessfully,  ///< end, with the best state so far
  kAbort,                  ///< end, with the state of before
};

/// Takes one line of text, without its line end. Called on the thread that solves.
using LogSink = std::function<void(const std::string& line)>;

/// Called after an iteration of a batch solve, on the thread that called Solve. `best_state` is
/// what a stop here would return, laid out like FactorGraph::state(): graph.ValuesIn(best_state,
/// id) are the values of a variable; the graph's own state stays that of the start until the solve
/// is over. Both arguments are good for the length of the call.
using IterationCallback =
    std::function<ObserverAction(const IterationSummary& iteration, const double* best_state)>;

/// Called after an iteration of an Update, on the thread that called Update, as
/// UpdateObserver::EndOfIteration is: IncrementalSolver::Values() gives the best state so far.
using UpdateCallback = std::function<ObserverAction(const UpdateIteration& iteration)>;

/// A sink that writes each line to a stream, which must outlive it, and flushes: LogTo(std::cout).
INCERES_EXPORT LogSink LogTo(std::ostream& stream);

/// The heading of the table of progress, as Ceres prints it, and the row of one iteration. Numbers
/// in the words of the program's C locale, as Ceres's.
INCERES_EXPORT std::string ProgressHeading();
/// The row of one iteration of a batch solve.
INCERES_EXPORT std::string ProgressRow(const IterationSummary& iteration);

/// The same for an Update, whose iterations have more to say: what kind of step it was (a '-'
/// behind it: refused), what is in Ceres's table, and how many frames moved and factors were
/// linearized. A gradient is given where there is one (UpdateIteration::gradient_max_norm).
INCERES_EXPORT std::string UpdateProgressHeading();
/// The row of one iteration of an Update.
INCERES_EXPORT std::string ProgressRow(const UpdateIteration& iteration);

}  // namespace inceres
