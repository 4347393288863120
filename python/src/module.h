#pragma once

#include <pybind11/pybind11.h>

namespace inceres::python {

// Each adds its part of the module `inceres._core`.

void BindLosses(pybind11::module_& module);
void BindManifolds(pybind11::module_& module);
void BindFamilies(pybind11::module_& module);
void BindCustomFamily(pybind11::module_& module);
void BindOptions(pybind11::module_& module);
void BindGraph(pybind11::module_& module);
void BindIncremental(pybind11::module_& module);
void BindFiles(pybind11::module_& module);

}  // namespace inceres::python
