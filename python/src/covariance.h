#pragma once

#include <functional>

#include "graph.h"
#include "inceres/solver/covariance.h"

namespace inceres::python {

using ComputeCovariance = std::function<Status(GraphCovariance*, const GraphCovariance::Pairs&)>;

/// (n, rows, columns) blocks of variables a with themselves, or of pairs; `compute` runs without
/// the GIL.
py::array CovarianceOf(const FactorGraph& graph, const Families& families, const py::object& a,
                       const py::object& b, const py::kwargs& options,
                       const ComputeCovariance& compute);

}  // namespace inceres::python
