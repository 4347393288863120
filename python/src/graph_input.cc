#include <algorithm>
#include <stdexcept>

#include "graph.h"

namespace inceres::python {
namespace {

// Of U, at the end of each row: nobody reads what is below its diagonal.
void CheckUpperTriangular(const DoubleArray& rows, int size) {
  const py::ssize_t first = rows.shape(1) - py::ssize_t{size} * size;
  for (py::ssize_t i = 0; i < rows.shape(0); ++i) {
    for (int k = 0; k < size * size; ++k) {
      const double entry = *rows.data(i, first + k);
      if (k % size < k / size && entry != 0.0) {
        throw py::value_error("measurements: row " + std::to_string(i) + ", column " +
                              std::to_string(first + k) + " is " +
                              py::repr(py::float_(entry)).cast<std::string>() +
                              ", below the diagonal of a square root information, which is upper "
                              "triangular");
      }
    }
  }
}

}  // namespace

void Families::Take(Family* family) {
  if (family->is_taken) {
    throw py::value_error(std::string("family: this one, '") + family->core()->Name() +
                          "', has been added before: a family belongs to one graph or solver");
  }
  family->is_taken = true;
}

Family& Families::at(FamilyId id) const {
  const auto found = families_.find(id);
  if (found == families_.end()) {
    throw py::value_error("family: " + std::to_string(id) + " is none that add_family returned");
  }
  return *found->second;
}

void Occupation::RefuseIfBusy(const char* call) const {
  if (busy_) {
    throw std::runtime_error(
        std::string(call) + ": it is being solved" +
        (thread_ == std::this_thread::get_id() ? "; not in a callback" : " by another thread"));
  }
}

void Occupation::RefuseOtherThreads(const char* call) const {
  if (busy_ && thread_ != std::this_thread::get_id()) {
    throw std::runtime_error(std::string(call) + ": it is being solved by another thread");
  }
}

std::vector<std::shared_ptr<const Loss>> ToLosses(const py::object& loss, std::size_t count) {
  if (loss.is_none()) {
    return {};
  }
  if (py::isinstance<Loss>(loss)) {
    return std::vector<std::shared_ptr<const Loss>>(count, loss.cast<std::shared_ptr<Loss>>());
  }
  if (!py::isinstance<py::sequence>(loss) || py::isinstance<py::str>(loss)) {
    throw py::type_error("loss: expected None, a Loss or a sequence of them");
  }
  if (py::len(loss) != count) {
    throw py::value_error("loss: " + std::to_string(py::len(loss)) + " losses for " +
                          std::to_string(count) + " factors");
  }
  std::vector<std::shared_ptr<const Loss>> losses;
  for (const py::handle& entry : loss) {
    if (!entry.is_none() && !py::isinstance<Loss>(entry)) {
      throw py::type_error("loss: entry " + std::to_string(losses.size()) + " is no Loss");
    }
    losses.push_back(entry.is_none() ? nullptr : entry.cast<std::shared_ptr<Loss>>());
  }
  return losses;
}

DoubleArray ToMeasurements(const Family& family, const py::object& measurements,
                           std::size_t count) {
  const std::vector<int>& columns = family.columns();
  if (measurements.is_none() && columns[0] == 0) {
    return DoubleArray(std::vector<py::ssize_t>{static_cast<py::ssize_t>(count), 0});
  }
  DoubleArray rows = ToMatrix(measurements, "measurements", -1);
  if (rows.shape(0) != static_cast<py::ssize_t>(count) ||
      std::find(columns.begin(), columns.end(), rows.shape(1)) == columns.end()) {
    std::string wanted;
    for (const int size : columns) {
      wanted += (wanted.empty() ? "(" : " or (") + std::to_string(count) + ", " +
                std::to_string(size) + ")";
    }
    throw py::value_error("measurements: shape " + ShapeOf(rows) + ", expected " + wanted +
                          " for '" + family.core()->Name() + "'");
  }
  if (rows.shape(1) == columns.back()) {
    CheckUpperTriangular(rows, family.root_size());
  }
  return rows;
}

FactorBatchInput ToFactors(const Family& family, const py::object& variables,
                           const py::object& measurements, const py::object& loss,
                           std::int64_t num_variables) {
  FactorBatchInput input;
  const int num_slots = family.core()->num_slots();
  input.variables = ToIndexMatrix(variables, "variables", num_slots, 0, num_variables);
  input.count = input.variables.size() / static_cast<std::size_t>(num_slots);
  input.measurements = ToMeasurements(family, measurements, input.count);
  input.num_columns = static_cast<int>(input.measurements.shape(1));
  input.losses = ToLosses(loss, input.count);
  return input;
}

Role ToRole(const std::string& name) {
  if (name != "frame" && name != "landmark") {
    throw py::value_error("role: '" + name + "', expected 'frame' or 'landmark'");
  }
  return name == "frame" ? Role::kFrame : Role::kLandmark;
}

std::vector<char> ToFlags(const py::object& value, const char* name, std::size_t count) {
  if (py::isinstance<py::bool_>(value)) {
    return std::vector<char>(count, value.cast<bool>() ? 1 : 0);
  }
  const auto array = py::array::ensure(value);
  if (!array || array.dtype().kind() != 'b' || array.ndim() > 1) {
    PyErr_Clear();
    throw py::type_error(std::string(name) + ": expected a bool or an array of bools (n,)");
  }
  const auto flags = py::array_t<bool, py::array::c_style | py::array::forcecast>(array);
  if (flags.ndim() == 0) {
    return std::vector<char>(count, *flags.data() ? 1 : 0);
  }
  if (flags.size() != static_cast<py::ssize_t>(count)) {
    throw py::value_error(std::string(name) + ": " + std::to_string(flags.size()) + " flags for " +
                          std::to_string(count) + " variables");
  }
  return std::vector<char>(flags.data(), flags.data() + flags.size());
}

// A side of bounds: None is none; one row is all variables'.
std::vector<double> ToBounds(const py::object& value, const char* name, std::size_t count,
                             std::size_t size) {
  if (value.is_none()) {
    return {};
  }
  const auto rows = DoubleArray::ensure(value);
  const bool one = rows && rows.ndim() == 1 && rows.size() == static_cast<py::ssize_t>(size);
  if (!one && !(rows && rows.ndim() == 2 && rows.shape(0) == static_cast<py::ssize_t>(count) &&
                rows.shape(1) == static_cast<py::ssize_t>(size))) {
    PyErr_Clear();
    throw py::value_error(std::string(name) + ": expected None, (" + std::to_string(size) +
                          ",) or (" + std::to_string(count) + ", " + std::to_string(size) + ")");
  }
  std::vector<double> bounds;
  for (std::size_t i = 0; i < count; ++i) {
    const double* row = rows.data() + (one ? 0 : i * size);
    bounds.insert(bounds.end(), row, row + size);
  }
  return bounds;
}

}  // namespace inceres::python
