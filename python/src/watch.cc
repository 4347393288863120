#include "watch.h"

#include <utility>

namespace inceres::python {
namespace {

py::dict ToRow(const IterationSummary& iteration) {
  py::dict row;
  row["iteration"] = iteration.iteration;
  row["cost"] = iteration.cost;
  row["cost_change"] = iteration.cost_change;
  row["gradient_max_norm"] = iteration.gradient_max_norm;
  row["gradient_norm"] = iteration.gradient_norm;
  row["step_norm"] = iteration.step_norm;
  row["model_cost_change"] = iteration.model_cost_change;
  row["relative_decrease"] = iteration.relative_decrease;
  row["trust_region_radius"] = iteration.trust_region_radius;
  row["valid"] = iteration.step_is_valid;
  row["successful"] = iteration.step_is_successful;
  row["nonmonotonic"] = iteration.step_is_nonmonotonic;
  row["seconds"] = iteration.iteration_time_in_seconds;
  row["cumulative_seconds"] = iteration.cumulative_time_in_seconds;
  return row;
}

py::dict ToRow(const UpdateIteration& iteration) {
  py::dict row;
  row["iteration"] = iteration.iteration;
  row["step"] = ToString(iteration.step);
  row["accepted"] = iteration.step_is_successful;
  row["cost"] = iteration.cost;
  row["cost_change"] = iteration.cost_change;
  row["predicted_change"] = iteration.model_cost_change;
  row["relative_decrease"] = iteration.relative_decrease;
  row["step_norm"] = iteration.step_norm;
  row["gradient_max_norm"] = iteration.gradient_max_norm;
  row["damping"] = iteration.damping;
  row["num_moved_frames"] = iteration.num_moved_frames;
  row["num_visited_landmarks"] = iteration.num_visited_landmarks;
  row["num_relinearised_factors"] = iteration.num_relinearized_factors;
  row["num_evaluated_factors"] = iteration.num_evaluated_factors;
  row["seconds"] = iteration.iteration_time_in_seconds;
  row["cumulative_seconds"] = iteration.cumulative_time_in_seconds;
  return row;
}

// The exception that is being handled, unless there was one before.
void KeepFirst(std::exception_ptr* kept) {
  if (*kept == nullptr) {
    *kept = std::current_exception();
  }
}

}  // namespace

ObserverAction Watch::Call(const py::dict& row) {
  try {
    const py::object answer = callback_(row);
    if (!answer.is_none() && !py::isinstance<py::bool_>(answer)) {
      throw py::type_error("callback: returned " + py::repr(answer).cast<std::string>() +
                           ", expected None or True to go on, False to stop and keep the result");
    }
    return answer.is_none() || answer.cast<bool>() ? ObserverAction::kContinue
                                                   : ObserverAction::kTerminateSuccessfully;
  } catch (py::error_already_set& error) {
    if (error.matches(PyExc_KeyboardInterrupt)) {
      interruption_ = std::current_exception();
      return ObserverAction::kTerminateSuccessfully;
    }
    raised_ = std::current_exception();
  } catch (...) {
    raised_ = std::current_exception();
  }
  return ObserverAction::kAbort;
}

bool Watch::Finish() {
  // Of every family: what it keeps would fail the next solve.
  for (const auto& [id, family] : families_.all()) {
    try {
      family->RaisePending();
    } catch (py::error_already_set& error) {
      KeepFirst(error.matches(PyExc_KeyboardInterrupt) ? &interruption_ : &raised_);
    } catch (...) {
      KeepFirst(&raised_);
    }
  }
  if (raised_ != nullptr) {
    std::rethrow_exception(std::exchange(raised_, nullptr));
  }
  return interruption_ != nullptr;
}

void Watch::RaiseInterrupted(const py::dict& summary) {
  try {
    std::rethrow_exception(std::exchange(interruption_, nullptr));
  } catch (py::error_already_set& error) {
    const py::object type = py::module_::import("inceres._errors").attr("Interrupted");
    const py::object interrupted = type("interrupted; the best state so far is kept", summary);
    interrupted.attr("__cause__") = error.value();
    PyErr_SetObject(type.ptr(), interrupted.ptr());
  }
  throw py::error_already_set();
}

ObserverAction SolveWatch::EndOfIteration(const IterationSummary& iteration,
                                          const double* best_state) {
  if (keeps_best_) {
    best_.assign(best_state, best_state + state_size_);
  }
  return watch_->Look([&] { return ToRow(iteration); });
}

ObserverAction UpdateWatch::EndOfIteration(const UpdateIteration& iteration) {
  return watch_->Look([&] { return ToRow(iteration); });
}

py::dict ToDict(const std::string& json) {
  return py::module_::import("json").attr("loads")(json).cast<py::dict>();
}

}  // namespace inceres::python
