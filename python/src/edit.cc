#include <limits>
#include <string>
#include <utility>

#include "incremental.h"

namespace inceres::python {
namespace {

constexpr std::int64_t kAnyId = std::numeric_limits<std::int32_t>::max();

// (n, 3): family, index, generation.
std::vector<FactorId> ToFactorIds(const py::object& value, const Families& families) {
  const std::vector<std::int32_t> numbers = ToIndexMatrix(value, "factors", 3, -1, kAnyId);
  std::vector<FactorId> ids;
  for (std::size_t i = 0; i + 2 < numbers.size(); i += 3) {
    families.at(numbers[i]);
    ids.push_back({numbers[i], numbers[i + 1], numbers[i + 2]});
  }
  return ids;
}

void Refuse(const Edit& edit, const char* call) {
  edit.solver->occupation.RefuseIfBusy(call);
}

IdArray AddVariables(Edit& edit, const py::object& values, const std::string& role,
                     const std::shared_ptr<Manifold>& manifold, const py::object& constant) {
  Refuse(edit, "add_variables");
  return AddVariablesTo(&edit.core, values, role, manifold, constant);
}

IdArray AddFactors(Edit& edit, FamilyId id, const py::object& variables,
                   const py::object& measurements, const py::object& loss) {
  Refuse(edit, "add_factors");
  Family& family = edit.solver->families.at(id);
  FactorBatchInput input = ToFactors(family, variables, measurements, loss, kAnyId);
  const auto num_slots = static_cast<std::size_t>(family.core()->num_slots());
  IdArray result({static_cast<py::ssize_t>(input.count), py::ssize_t{3}});
  std::int32_t* to = result.mutable_data();
  std::vector<std::int32_t> places;
  for (std::size_t i = 0; i < input.count; ++i) {
    const VariableId* ids = input.variables.data() + i * num_slots;
    const FactorId factor = edit.core.Connect(id, ids, input.LossOf(i));
    places.push_back(factor.index);
    *to++ = factor.family;
    *to++ = factor.index;
    *to++ = factor.generation;
  }
  // A copy of the measurements: their array is the caller's.
  const double* const rows = input.measurements.data();
  edit.coming.push_back({&family, std::move(places), std::move(input.variables),
                         std::vector<double>(rows, rows + input.measurements.size()),
                         input.num_columns});
  return result;
}

void RemoveVariables(Edit& edit, const py::object& ids) {
  Refuse(edit, "remove_variables");
  for (const VariableId id : ToIndexList(ids, "ids", 0, kAnyId)) {
    edit.core.RemoveVariable(id);
  }
}

void RemoveFactors(Edit& edit, const py::object& factors) {
  Refuse(edit, "remove_factors");
  for (const FactorId id : ToFactorIds(factors, edit.solver->families)) {
    edit.core.RemoveFactor(id);
  }
}

void SetMeasurements(Edit& edit, const py::object& factors, const py::object& measurements) {
  Refuse(edit, "set_measurements");
  const Families& families = edit.solver->families;
  const std::vector<FactorId> ids = ToFactorIds(factors, families);
  if (ids.empty()) {
    return;
  }
  Family& family = families.at(ids[0].family);
  const DoubleArray rows = ToMeasurements(family, measurements, ids.size());
  const auto num_columns = static_cast<int>(rows.shape(1));
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (ids[i].family != ids[0].family) {
      throw py::value_error("factors: row " + std::to_string(i) +
                            " is of another family than row 0");
    }
  }
  for (std::size_t i = 0; i < ids.size(); ++i) {
    family.SetMeasurement(ids[i], rows.data() + i * static_cast<std::size_t>(num_columns),
                          num_columns, &edit.core);
  }
}

void SetLoss(Edit& edit, const py::object& factors, const py::object& loss) {
  Refuse(edit, "set_loss");
  const std::vector<FactorId> ids = ToFactorIds(factors, edit.solver->families);
  const auto losses = ToLosses(loss, ids.size());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    edit.core.SetLoss(ids[i], losses.empty() ? nullptr : losses[i]);
  }
}

void SetConstant(Edit& edit, const py::object& ids, const py::object& constant) {
  Refuse(edit, "set_constant");
  const std::vector<VariableId> variables = ToIndexList(ids, "ids", 0, kAnyId);
  const std::vector<char> held = ToFlags(constant, "constant", variables.size());
  for (std::size_t i = 0; i < variables.size(); ++i) {
    edit.core.SetConstant(variables[i], held[i] != 0);
  }
}

void SetValues(Edit& edit, const py::object& ids, const py::object& values) {
  Refuse(edit, "set_values");
  const FactorGraph& graph = edit.solver->core.graph();
  const std::vector<VariableId> variables = ToVariables(graph, ids, "ids");
  const DoubleArray rows = ToValues(graph, variables, values, "values");
  for (std::size_t i = 0; i < variables.size(); ++i) {
    edit.core.SetValues(variables[i], rows.data(static_cast<py::ssize_t>(i), 0));
  }
}

void SetBounds(Edit& edit, const py::object& ids, const py::object& lower,
               const py::object& upper) {
  Refuse(edit, "set_bounds");
  const FactorGraph& graph = edit.solver->core.graph();
  ApplyBounds(graph, ToVariables(graph, ids, "ids"), lower, upper,
              [&edit](VariableId id, const double* low, const double* high) {
                edit.core.SetBounds(id, low, high);
              });
}

void SetEliminationGroup(Edit& edit, const py::object& ids, int group) {
  Refuse(edit, "set_elimination_group");
  for (const VariableId id : ToIndexList(ids, "ids", 0, kAnyId)) {
    edit.core.SetEliminationGroup(id, group);
  }
}

}  // namespace

void ComingFactors::Place() const {
  const auto num_slots = static_cast<std::size_t>(family->core()->num_slots());
  for (std::size_t i = 0; i < places.size(); ++i) {
    family->Place(places[i], measurements.data() + i * static_cast<std::size_t>(num_columns),
                  num_columns);
    family->Connect(places[i], variables.data() + i * num_slots);
  }
}

void Edit::Restart() {
  core.Restart();
  coming.clear();
}

void ApplyEdit(Edit* edit) {
  Refuse(*edit, "apply");
  // No factor has these places if the edit is of the graph as it is now. Else it is refused, and
  // they may be those of factors that have come since.
  if (edit->core.revision() == edit->solver->core.graph().revision()) {
    for (const ComingFactors& factors : edit->coming) {
      factors.Place();
    }
  }
  Check(edit->solver->core.Apply(edit->core));
  edit->Restart();
}

void BindEdit(py::module_& module) {
  py::class_<Edit, std::shared_ptr<Edit>>(
      module, "Edit",
      "Changes of an IncrementalSolver's problem, carried out all together by apply(), or at the "
      "end of a `with`, or, if any is wrong, not at all. Ids are given out at once; they belong to "
      "the problem only then. One edit at a time: once another one was applied apply() raises "
      "ValueError, and restart() begins anew.")
      .def("add_variables", &AddVariables, py::arg("values"), py::arg("role") = "frame",
           py::arg("manifold").none(true) = std::shared_ptr<Manifold>(),
           py::arg("constant") = false, "As FactorGraph.add_variables.")
      .def("remove_variables", &RemoveVariables, py::arg("ids"),
           "Removes variables with all factors that touch them.")
      .def("add_factors", &AddFactors, py::arg("family"), py::arg("variables"),
           py::arg("measurements") = py::none(), py::arg("loss") = py::none(),
           "As FactorGraph.add_factors, but returns ids (n, 3) that stay good when other factors "
           "go.")
      .def("remove_factors", &RemoveFactors, py::arg("factors"))
      .def("set_measurements", &SetMeasurements, py::arg("factors"), py::arg("measurements"),
           "New measurements for factors of one family.")
      .def("set_loss", &SetLoss, py::arg("factors"), py::arg("loss"))
      .def("set_constant", &SetConstant, py::arg("ids"), py::arg("constant") = true)
      .def("set_values", &SetValues, py::arg("ids"), py::arg("values"),
           "New values for variables the solver has.")
      .def("set_bounds", &SetBounds, py::arg("ids"), py::arg("lower") = py::none(),
           py::arg("upper") = py::none(),
           "Keeps variables the solver has within bounds, as FactorGraph.set_bounds; None on both "
           "sides lifts them. Of values in R^n; what is outside goes to the nearest bound.")
      .def("set_elimination_group", &SetEliminationGroup, py::arg("ids"), py::arg("group"),
           "As FactorGraph.set_elimination_group.")
      .def("apply", &ApplyEdit, "Carries the edit out; the object is then a new, empty one.")
      .def(
          "restart",
          [](Edit& edit) {
            Refuse(edit, "restart");
            edit.Restart();
          },
          "Forgets all changes.")
      .def("__enter__", [](std::shared_ptr<Edit> edit) { return edit; })
      .def(
          "__exit__",
          [](Edit& edit, const py::object& type, const py::object&, const py::object&) {
            if (type.is_none()) {
              ApplyEdit(&edit);
            }
          },
          py::arg("type"), py::arg("value"), py::arg("traceback"));
}

}  // namespace inceres::python
