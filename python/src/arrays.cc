#include "arrays.h"

#include <cmath>
#include <stdexcept>

namespace inceres::python {
namespace {

[[noreturn]] void RaiseShape(const char* name, const py::array& array, const std::string& wanted) {
  throw py::value_error(std::string(name) + ": shape " + ShapeOf(array) + ", expected " + wanted);
}

std::string Rows(py::ssize_t columns) {
  return columns < 0 ? "(n, m)" : "(n, " + std::to_string(columns) + ")";
}

DoubleArray ToDoubles(const py::object& value, const char* name) {
  const auto raw = py::array::ensure(value);
  if (!raw ||
      (raw.dtype().kind() != 'f' && raw.dtype().kind() != 'i' && raw.dtype().kind() != 'u')) {
    PyErr_Clear();
    throw py::type_error(std::string(name) + ": not an array of real numbers");
  }
  return DoubleArray::ensure(raw);
}

void CheckFinite(const DoubleArray& array, const char* name) {
  const double* values = array.data();
  double sum = 0.0;  // what is not finite makes it so; it may also overflow
  for (py::ssize_t i = 0; i < array.size(); ++i) {
    sum += 0.0 * values[i];
  }
  for (py::ssize_t i = 0; !(sum == 0.0) && i < array.size(); ++i) {
    if (!std::isfinite(values[i])) {
      const py::ssize_t columns = array.ndim() > 1 ? array.shape(1) : 1;
      throw py::value_error(std::string(name) + ": row " + std::to_string(i / columns) +
                            ", column " + std::to_string(i % columns) + " is not finite");
    }
  }
}

}  // namespace

std::string ShapeOf(const py::array& array) {
  std::string text = "(";
  for (py::ssize_t d = 0; d < array.ndim(); ++d) {
    text += (d > 0 ? ", " : "") + std::to_string(array.shape(d));
  }
  return text + (array.ndim() == 1 ? ",)" : ")");
}

DoubleArray ToMatrix(const py::object& value, const char* name, py::ssize_t columns) {
  DoubleArray array = ToDoubles(value, name);
  if (array.ndim() != 2 || (columns >= 0 && array.shape(1) != columns)) {
    RaiseShape(name, array, Rows(columns));
  }
  CheckFinite(array, name);
  return array;
}

std::vector<std::int32_t> ToIndices(const py::object& value, const char* name, std::int64_t low,
                                    std::int64_t high, std::vector<py::ssize_t>* shape) {
  const auto raw = py::array::ensure(value);
  const bool empty = raw && raw.size() == 0;  // a list without entries is one of floats to NumPy
  if (!raw || (!empty && raw.dtype().kind() != 'i' && raw.dtype().kind() != 'u')) {
    PyErr_Clear();
    throw py::type_error(std::string(name) + ": not an array of whole numbers");
  }
  const auto wide = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>(raw);
  std::vector<std::int32_t> result(static_cast<std::size_t>(wide.size()));
  for (py::ssize_t i = 0; i < wide.size(); ++i) {
    const std::int64_t index = wide.data()[i];
    if (index < low || index >= high) {
      throw py::value_error(std::string(name) + ": entry " + std::to_string(i) + " is " +
                            std::to_string(index) + ", not in [" + std::to_string(low) + ", " +
                            std::to_string(high) + ")");
    }
    result[static_cast<std::size_t>(i)] = static_cast<std::int32_t>(index);
  }
  if (shape != nullptr) {
    shape->assign(wide.shape(), wide.shape() + wide.ndim());
  }
  return result;
}

std::vector<std::int32_t> ToIndexList(const py::object& value, const char* name, std::int64_t low,
                                      std::int64_t high) {
  std::vector<py::ssize_t> shape;
  std::vector<std::int32_t> result = ToIndices(value, name, low, high, &shape);
  if (shape.size() > 1) {
    RaiseShape(name, py::array::ensure(value), "(n,)");
  }
  return result;
}

std::vector<std::int32_t> ToIndexMatrix(const py::object& value, const char* name,
                                        py::ssize_t columns, std::int64_t low, std::int64_t high) {
  std::vector<py::ssize_t> shape;
  std::vector<std::int32_t> result = ToIndices(value, name, low, high, &shape);
  if (shape.size() != 2 || shape[1] != columns) {
    RaiseShape(name, py::array::ensure(value), Rows(columns));
  }
  return result;
}

IdArray ToIdArray(const std::vector<std::int32_t>& ids) {
  return IdArray(static_cast<py::ssize_t>(ids.size()), ids.data());
}

std::vector<VariableId> ToVariables(const FactorGraph& graph, const py::object& value,
                                    const char* name) {
  std::vector<VariableId> ids = ToIndexList(value, name, 0, graph.num_variables());
  for (const VariableId id : ids) {
    if (!graph.HasVariable(id)) {
      throw py::value_error(std::string(name) + ": variable " + std::to_string(id) +
                            " was removed");
    }
  }
  return ids;
}

DoubleArray ToValues(const FactorGraph& graph, const std::vector<VariableId>& ids,
                     const py::object& value, const char* name) {
  DoubleArray values = ToMatrix(value, name, CommonAmbientSize(graph, ids));
  if (values.shape(0) != static_cast<py::ssize_t>(ids.size())) {
    RaiseShape(name, values, "as many rows as ids, " + std::to_string(ids.size()));
  }
  return values;
}

int CommonAmbientSize(const FactorGraph& graph, const std::vector<VariableId>& ids) {
  for (const VariableId id : ids) {
    if (graph.AmbientSize(id) != graph.AmbientSize(ids[0])) {
      throw py::value_error("ids: variable " + std::to_string(id) + " has " +
                            std::to_string(graph.AmbientSize(id)) + " values, variable " +
                            std::to_string(ids[0]) + " has " +
                            std::to_string(graph.AmbientSize(ids[0])));
    }
  }
  return ids.empty() ? 0 : graph.AmbientSize(ids[0]);
}

void Check(const Status& status) {
  switch (status.code) {
    case StatusCode::kOk:
      return;
    case StatusCode::kInvalidArgument:
      throw py::value_error(status.message);
    case StatusCode::kIo:
      PyErr_SetString(PyExc_OSError, status.message.c_str());
      throw py::error_already_set();
    case StatusCode::kEvaluationFailed:
    case StatusCode::kSingular:
    case StatusCode::kUnavailable:
      throw std::runtime_error(status.message);
  }
}

}  // namespace inceres::python
