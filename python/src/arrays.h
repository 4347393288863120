#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

namespace inceres::python {

namespace py = pybind11;

// What comes from Python is checked here, and messages name the argument: wrong shapes and values
// are ValueError, wrong kinds TypeError.

/// An array of doubles, row by row; no copy of one that is so already.
using DoubleArray = py::array_t<double, py::array::c_style | py::array::forcecast>;
using IdArray = py::array_t<std::int32_t, py::array::c_style>;

/// "(3, 2)", as Python writes it.
std::string ShapeOf(const py::array& array);

/// (n, columns); `columns` −1: any. A number that is not finite is an error.
DoubleArray ToMatrix(const py::object& value, const char* name, py::ssize_t columns);

/// Whole numbers of any shape, flattened, each in [low, high).
std::vector<std::int32_t> ToIndices(const py::object& value, const char* name, std::int64_t low,
                                    std::int64_t high, std::vector<py::ssize_t>* shape = nullptr);
/// The same of shape (n,), or a single number.
std::vector<std::int32_t> ToIndexList(const py::object& value, const char* name, std::int64_t low,
                                      std::int64_t high);
/// (n, columns) whole numbers in [low, high).
std::vector<std::int32_t> ToIndexMatrix(const py::object& value, const char* name,
                                        py::ssize_t columns, std::int64_t low, std::int64_t high);

IdArray ToIdArray(const std::vector<std::int32_t>& ids);

/// Ids of variables of the graph.
std::vector<VariableId> ToVariables(const FactorGraph& graph, const py::object& value,
                                    const char* name);
/// (number of ids, their common ambient size) values of these variables.
DoubleArray ToValues(const FactorGraph& graph, const std::vector<VariableId>& ids,
                     const py::object& value, const char* name);
/// The ambient size of all of them; ValueError if they differ. 0 without any.
int CommonAmbientSize(const FactorGraph& graph, const std::vector<VariableId>& ids);

/// Raises what the status says: ValueError, OSError (kIo) or RuntimeError (numbers, memory).
void Check(const Status& status);

}  // namespace inceres::python
