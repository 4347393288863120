#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "covariance.h"
#include "graph.h"
#include "inceres/solver/solver.h"
#include "module.h"
#include "options.h"
#include "watch.h"

namespace inceres::python {
namespace {

IdArray AddVariables(Graph& graph, const py::object& values, const std::string& role,
                     const std::shared_ptr<Manifold>& manifold, const py::object& constant) {
  graph.occupation.RefuseIfBusy("add_variables");
  return AddVariablesTo(&graph.core, values, role, manifold, constant);
}

FamilyId AddFamily(Graph& graph, const std::shared_ptr<Family>& family) {
  graph.occupation.RefuseIfBusy("add_family");
  return graph.families.Add(family, &graph.core);
}

IdArray AddFactors(Graph& graph, FamilyId id, const py::object& variables,
                   const py::object& measurements, const py::object& loss) {
  graph.occupation.RefuseIfBusy("add_factors");
  Family& family = graph.families.at(id);
  FactorBatchInput input =
      ToFactors(family, variables, measurements, loss, graph.core.num_variables());
  const int first = graph.core.NumFactors(id);
  std::vector<std::int32_t> indices;
  for (std::size_t i = 0; i < input.count; ++i) {
    const int index = first + static_cast<int>(i);
    family.Place(index, input.Row(i), input.num_columns);
    family.Connect(
        index, input.variables.data() + i * static_cast<std::size_t>(family.core()->num_slots()));
    indices.push_back(index);
  }
  graph.core.ConnectMany(id, std::move(input.variables), std::move(input.losses));
  return ToIdArray(indices);
}

void SetConstant(Graph& graph, const py::object& ids, const py::object& constant) {
  graph.occupation.RefuseIfBusy("set_constant");
  const std::vector<VariableId> variables = ToVariables(graph.core, ids, "ids");
  const std::vector<char> held = ToFlags(constant, "constant", variables.size());
  for (std::size_t i = 0; i < variables.size(); ++i) {
    graph.core.SetConstant(variables[i], held[i] != 0);
  }
}

void SetValues(Graph& graph, const py::object& ids, const py::object& values) {
  graph.occupation.RefuseIfBusy("set_values");
  const std::vector<VariableId> variables = ToVariables(graph.core, ids, "ids");
  const DoubleArray rows = ToValues(graph.core, variables, values, "values");
  for (std::size_t i = 0; i < variables.size(); ++i) {
    graph.core.SetValues(variables[i], rows.data(static_cast<py::ssize_t>(i), 0));
  }
}

void SetBounds(Graph& graph, const py::object& ids, const py::object& lower,
               const py::object& upper) {
  graph.occupation.RefuseIfBusy("set_bounds");
  const std::vector<VariableId> variables = ToVariables(graph.core, ids, "ids");
  ApplyBounds(graph.core, variables, lower, upper,
              [&graph](VariableId id, const double* low, const double* high) {
                graph.core.SetBounds(id, low, high);
              });
}

void SetEliminationGroup(Graph& graph, const py::object& ids, int group) {
  graph.occupation.RefuseIfBusy("set_elimination_group");
  for (const VariableId id : ToVariables(graph.core, ids, "ids")) {
    graph.core.SetEliminationGroup(id, group);
  }
}

void SetLoss(Graph& graph, FamilyId id, const py::object& factors, const py::object& loss) {
  graph.occupation.RefuseIfBusy("set_loss");
  graph.families.at(id);
  const std::vector<std::int32_t> indices =
      ToIndexList(factors, "factors", 0, graph.core.NumFactors(id));
  const auto losses = ToLosses(loss, indices.size());
  for (std::size_t i = 0; i < indices.size(); ++i) {
    graph.core.SetLoss(id, indices[i], losses.empty() ? nullptr : losses[i]);
  }
}

bool HasPythonFunctions(const Graph& graph) {
  return std::any_of(graph.families.all().begin(), graph.families.all().end(),
                     [](const auto& family) { return family.second->core()->Prepares(); });
}

py::dict SolveGraph(Graph& graph, const py::object& callback, const py::kwargs& given) {
  SolverOptions options = ToSolverOptions(given);
  Watch watch(callback, graph.families);
  SolveWatch observer(&watch, HasPythonFunctions(graph));
  observer.set_state_size(graph.core.state().size());
  options.observer = &observer;
  const Occupation::Guard guard(&graph.occupation, "solve");
  Summary summary;
  {
    const py::gil_scoped_release no_gil;
    summary = Solve(options, &graph.core);
  }
  const bool interrupted = watch.Finish();
  if (!summary.IsSolutionUsable()) {
    Check(graph.core.Validate());  // a graph that cannot be solved is an error of the caller
  }
  if (interrupted && !summary.IsSolutionUsable() && !observer.best().empty()) {
    graph.core.mutable_state() = observer.best();
  }
  const py::dict result = ToDict(summary.ToJson());
  if (interrupted) {
    watch.RaiseInterrupted(result);
  }
  return result;
}

// Of a copy with all variables held a solve evaluates the cost, and neither Jacobians nor steps. A
// bound that a constant's values break would be an error: there are none.
Summary SolveStandstill(FactorGraph graph) {
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    graph.SetBounds(id, nullptr, nullptr);
    graph.SetConstant(id, true);
  }
  return Solve(SolverOptions(), &graph);
}

double CostOf(Graph& graph) {
  const Occupation::Guard guard(&graph.occupation, "cost");
  const Summary summary =
      CallWithoutGil(graph.families, [&graph] { return SolveStandstill(graph.core); });
  if (summary.initial_cost < 0.0) {
    throw std::runtime_error(summary.message + " " + summary.detail);
  }
  return summary.initial_cost;
}

py::array CovarianceInGraph(Graph& graph, const py::object& a, const py::object& b,
                            const py::kwargs& options) {
  const Occupation::Guard guard(&graph.occupation, "covariance");
  return CovarianceOf(graph.core, graph.families, a, b, options,
                      [&graph](GraphCovariance* covariance, const GraphCovariance::Pairs& pairs) {
                        return covariance->Compute(graph.core, pairs);
                      });
}

}  // namespace

void BindGraph(py::module_& module) {
  py::class_<Graph, std::shared_ptr<Graph>>(
      module, "FactorGraph",
      "The problem min 1/2 sum rho(|f(x)|^2): variables on manifolds, factors in families, losses, "
      "constants. Everything comes and goes in batches.")
      .def(py::init<>())
      .def("add_variables", &AddVariables, py::arg("values"), py::arg("role") = "frame",
           py::arg("manifold").none(true) = std::shared_ptr<Manifold>(),
           py::arg("constant") = false,
           "Adds variables, a row (n, size) each, and returns their ids (n,). Landmarks (size 1 to "
           "4, at most one a factor) are eliminated first.")
      .def("add_family", &AddFamily, py::arg("family").none(false),
           "Adds a family and returns its id.")
      .def("add_factors", &AddFactors, py::arg("family"), py::arg("variables"),
           py::arg("measurements") = py::none(), py::arg("loss") = py::none(),
           "Adds factors to the family: ids of the variables (n, slots), a row of measurements "
           "each, no loss, one for all or a list. Returns their indices in the family (n,).")
      .def("set_constant", &SetConstant, py::arg("ids"), py::arg("constant") = true,
           "Holds variables constant, or sets them free.")
      .def("set_values", &SetValues, py::arg("ids"), py::arg("values"))
      .def("set_bounds", &SetBounds, py::arg("ids"), py::arg("lower") = py::none(),
           py::arg("upper") = py::none(), "Keeps values within bounds; None lifts a side.")
      .def("set_elimination_group", &SetEliminationGroup, py::arg("ids"), py::arg("group"),
           "When frames are eliminated from the reduced system: lower groups first; 0 unless told "
           "otherwise.")
      .def("set_loss", &SetLoss, py::arg("family"), py::arg("factors"), py::arg("loss"))
      .def(
          "values",
          [](Graph& graph, const py::object& ids) {
            graph.occupation.RefuseIfBusy("values");
            return StackValues(graph.core, ToVariables(graph.core, ids, "ids"),
                               [&](VariableId id) { return graph.core.Values(id); });
          },
          py::arg("ids"), "Current values of variables of one size, a row each: a copy.")
      .def(
          "validate",
          [](Graph& graph) {
            graph.occupation.RefuseIfBusy("validate");
            Check(graph.core.Validate());
          },
          "Raises ValueError naming the first thing that makes the graph unsolvable.")
      .def("cost", &CostOf,
           "1/2 sum rho at the current values, which stay, within their bounds or not.")
      .def("solve", &SolveGraph, py::arg("callback") = py::none(),
           "Minimizes the cost and returns a summary. Keyword arguments are solver_options(). The "
           "callback gets a dict after each iteration; returning False stops and keeps the result, "
           "what it raises ends the solve, with the values of before, and is raised here. Ctrl-C "
           "keeps the best state and raises Interrupted, which has the summary.")
      .def("covariance", &CovarianceInGraph, py::arg("a"), py::arg("b") = py::none(),
           "Covariances (n, tangent size, tangent size) of variables a, or of pairs a[i], b[i]. "
           "Keyword arguments: num_threads, max_inflation, algorithm ('schur', 'qr', 'dense_svd'), "
           "and of 'dense_svd' null_space_rank and min_reciprocal_condition_number.")
      .def(
          "num_factors",
          [](const Graph& graph, const py::object& family) {
            graph.occupation.RefuseIfBusy("num_factors");
            if (family.is_none()) {
              return graph.core.num_factors();
            }
            graph.families.at(family.cast<FamilyId>());
            return graph.core.NumFactors(family.cast<FamilyId>());
          },
          py::arg("family") = py::none())
      .def_property_readonly("num_variables", [](const Graph& graph) {
        graph.occupation.RefuseIfBusy("num_variables");
        return graph.core.num_variables();
      });
}

}  // namespace inceres::python
