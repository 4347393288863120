#pragma once

#include <exception>
#include <string>
#include <vector>

#include "graph.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"

namespace inceres::python {

/// Looks on while a solver works without the GIL: takes it after each iteration, calls the user's
/// callback, and sees whether Ctrl-C was pressed or a Python function of a factor has raised.
class Watch {
 public:
  /// `callback` may be None.
  Watch(py::object callback, const Families& families)
      : callback_(std::move(callback)), families_(families) {}

  /// What to do after an iteration, which `row` makes a dict of. Takes the GIL.
  template <typename MakeRow>
  ObserverAction Look(const MakeRow& make_row) {
    const py::gil_scoped_acquire gil;
    for (const auto& [id, family] : families_.all()) {
      if (family->HasPending()) {
        return ObserverAction::kAbort;
      }
    }
    try {
      if (PyErr_CheckSignals() != 0) {
        throw py::error_already_set();
      }
    } catch (...) {
      interruption_ = std::current_exception();
      return ObserverAction::kTerminateSuccessfully;
    }
    return callback_.is_none() ? ObserverAction::kContinue : Call(make_row());
  }

  bool has_callback() const { return !callback_.is_none(); }

  /// With the GIL, once the solver is done: raises what a callback has raised, or else what a
  /// factor's function has, that of the first family if there are several; no family then keeps
  /// anything. Returns whether the user has interrupted, in a factor's function or between.
  bool Finish();
  /// Raises Interrupted, which carries the summary and the interruption's own exception.
  [[noreturn]] void RaiseInterrupted(const py::dict& summary);

 private:
  ObserverAction Call(const py::dict& row);

  py::object callback_;
  const Families& families_;
  std::exception_ptr raised_;
  std::exception_ptr interruption_;
};

/// What call() returns, which works without the GIL and has no iterations to look on at. Raises
/// what a factor's function has raised, and Interrupted, without a summary, for Ctrl-C in one.
template <typename Call>
auto CallWithoutGil(const Families& families, const Call& call) {
  Watch watch(py::none(), families);
  auto result = [&call] {
    const py::gil_scoped_release no_gil;
    return call();
  }();
  if (watch.Finish()) {
    watch.RaiseInterrupted(py::dict());
  }
  return result;
}

class SolveWatch final : public SolveObserver {
 public:
  SolveWatch(Watch* watch, bool keeps_best) : watch_(watch), keeps_best_(keeps_best) {}

  ObserverAction EndOfIteration(const IterationSummary& iteration,
                                const double* best_state) override;
  /// The best state so far; empty unless it keeps it.
  const std::vector<double>& best() const { return best_; }
  void set_state_size(std::size_t size) { state_size_ = size; }

 private:
  Watch* watch_;
  bool keeps_best_;
  std::size_t state_size_ = 0;
  std::vector<double> best_;
};

class UpdateWatch final : public UpdateObserver {
 public:
  explicit UpdateWatch(Watch* watch) : watch_(watch) {}
  ObserverAction EndOfIteration(const UpdateIteration& iteration) override;

 private:
  Watch* watch_;
};

/// The dict of a summary's JSON.
py::dict ToDict(const std::string& json);

}  // namespace inceres::python
