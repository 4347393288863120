#pragma once

#include <pybind11/pybind11.h>

#include "inceres/solver/incremental_options.h"
#include "inceres/solver/options.h"

namespace inceres::python {

/// Of keyword arguments by the names of the options in C++; what a string names is an enum. An
/// unknown name is TypeError, a wrong value ValueError; both name it.
SolverOptions ToSolverOptions(const pybind11::dict& options);
IncrementalOptions ToIncrementalOptions(const pybind11::dict& options);

}  // namespace inceres::python
