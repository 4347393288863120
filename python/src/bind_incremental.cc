#include <memory>
#include <string>
#include <vector>

#include <pybind11/stl.h>

#include "covariance.h"
#include "inceres/solver/marginalization.h"
#include "incremental.h"
#include "module.h"
#include "options.h"
#include "watch.h"

namespace inceres::python {
namespace {

FamilyId AddFamily(LivingSolver& solver, const std::shared_ptr<Family>& family) {
  solver.occupation.RefuseIfBusy("add_family");
  return solver.families.Add(family, &solver.core);
}

py::dict Update(LivingSolver& solver, const py::object& callback, bool interruptible) {
  Watch watch(callback, solver.families);
  UpdateWatch observer(&watch);
  const bool watches = interruptible || watch.has_callback();
  const Occupation::Guard guard(&solver.occupation, "update");
  UpdateSummary summary;
  {
    const py::gil_scoped_release no_gil;
    solver.core.Update(&summary, watches ? &observer : nullptr);
  }
  const bool interrupted = watch.Finish();
  const py::dict result = ToDict(summary.ToJson());
  if (interrupted) {
    watch.RaiseInterrupted(result);
  }
  return result;
}

py::array_t<double> Values(LivingSolver& solver, const py::object& ids) {
  solver.occupation.RefuseOtherThreads("values");
  const FactorGraph& graph = solver.core.graph();
  return StackValues(graph, ToVariables(graph, ids, "ids"),
                     [&](VariableId id) { return solver.core.Values(id); });
}

py::array SolverCovariance(LivingSolver& solver, const py::object& a, const py::object& b,
                           const py::kwargs& options) {
  const Occupation::Guard guard(&solver.occupation, "covariance");
  return CovarianceOf(solver.core.graph(), solver.families, a, b, options,
                      [&solver](GraphCovariance* covariance, const GraphCovariance::Pairs& pairs) {
                        return covariance->Compute(solver.core, pairs);
                      });
}

py::dict MarginalizeVariables(LivingSolver& solver, const py::object& ids,
                              const py::object& dropped, bool allow_rank_loss,
                              bool first_estimate_jacobians) {
  const Occupation::Guard guard(&solver.occupation, "marginalize");
  const FactorGraph& graph = solver.core.graph();
  MarginalizationRequest request;
  request.marginalized = ToVariables(graph, ids, "ids");
  if (!dropped.is_none()) {
    request.dropped = ToVariables(graph, dropped, "dropped");
  }
  MarginalizationOptions options;
  options.allow_rank_loss = allow_rank_loss;
  options.first_estimate_jacobians = first_estimate_jacobians;
  const MarginalizationSummary summary =
      CallWithoutGil(solver.families, [&] { return solver.core.Marginalize(request, options); });
  Check(summary.status);
  py::dict result;
  result["kept"] = ToIdArray(summary.kept);
  result["rank"] = summary.rank;
  result["num_factors"] = summary.num_factors;
  result["fixed_cost"] = summary.fixed_cost;
  return result;
}

}  // namespace

void BindIncremental(py::module_& module) {
  BindEdit(module);
  py::class_<LivingSolver, std::shared_ptr<LivingSolver>>(
      module, "IncrementalSolver",
      "The solver that remembers: edit the problem, then update(); after the first time work goes "
      "with what changed. Keyword arguments are incremental_options().")
      .def(py::init([](const py::kwargs& options) {
        return std::make_shared<LivingSolver>(ToIncrementalOptions(options));
      }))
      .def("add_family", &AddFamily, py::arg("family").none(false),
           "Adds a family, for good, and returns its id; before an edit is begun.")
      .def(
          "edit",
          [](LivingSolver& solver) {
            solver.occupation.RefuseIfBusy("edit");
            return std::make_shared<Edit>(solver.shared_from_this());
          },
          "Begins an edit.")
      .def(
          "set_options",
          [](LivingSolver& solver, const py::kwargs& options) {
            solver.occupation.RefuseIfBusy("set_options");
            solver.core.SetOptions(ToIncrementalOptions(options));
          },
          "Other options from the next update on, the rest their defaults; num_threads and "
          "reduced_solver stay what they were.")
      .def("update", &Update, py::arg("callback") = py::none(), py::arg("interruptible") = true,
           "Minimizes from the current state and returns the counts of what it did. The callback "
           "is as in FactorGraph.solve, and may read values(). Without a callback and not "
           "interruptible by Ctrl-C, no pass over all variables is made.")
      .def("values", &Values, py::arg("ids"),
           "Current values of variables of one size, a row each: a copy.")
      .def(
          "request_stop", [](LivingSolver& solver) { solver.core.RequestStop(); },
          "From any thread: the update that runs now, or else the next one, ends at its next "
          "iteration with the best state so far.")
      .def("covariance", &SolverCovariance, py::arg("a"), py::arg("b") = py::none(),
           "As FactorGraph.covariance: everything is linearized and factored anew.")
      .def(
          "live_covariance", &LiveCovarianceOf, py::arg("ids"), py::arg("accuracy") = "undamped",
          py::arg("tolerance") = LiveCovarianceOptions().tolerance,
          py::arg("max_iterations") = LiveCovarianceOptions().max_iterations,
          "The joint covariance of variables, in their tangent spaces, from what the last update "
          "has left: (n, n), in the order of ids, and a dict that tells how far its factor is from "
          "the values held. accuracy: 'as_factored', 'undamped' or 'exact'; the other two are of "
          "'exact'.")
      .def("marginalize", &MarginalizeVariables, py::arg("ids"), py::arg("dropped") = py::none(),
           py::arg("allow_rank_loss") = false, py::arg("first_estimate_jacobians") = false,
           "Removes variables and keeps what their factors say about others as a prior; those "
           "dropped go with all they knew. Returns kept (ids), rank, num_factors, fixed_cost.")
      .def_property_readonly(
          "cost",
          [](LivingSolver& solver) {
            solver.occupation.RefuseOtherThreads("cost");
            return solver.core.cost();
          },
          "1/2 sum rho as of the last update.")
      .def_property_readonly("num_variables",
                             [](LivingSolver& solver) {
                               solver.occupation.RefuseOtherThreads("num_variables");
                               return solver.core.graph().num_live_variables();
                             })
      .def_property_readonly("num_factors", [](LivingSolver& solver) {
        solver.occupation.RefuseOtherThreads("num_factors");
        return solver.core.graph().num_factors();
      });
}

}  // namespace inceres::python
