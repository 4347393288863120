#pragma once

#include <functional>
#include <string>

#include "graph.h"
#include "inceres/solver/covariance.h"
#include "incremental.h"

namespace inceres::python {

using ComputeCovariance = std::function<Status(GraphCovariance*, const GraphCovariance::Pairs&)>;

/// (n, rows, columns) blocks of variables a with themselves, or of pairs; `compute` runs without
/// the GIL.
py::array CovarianceOf(const FactorGraph& graph, const Families& families, const py::object& a,
                       const py::object& b, const py::kwargs& options,
                       const ComputeCovariance& compute);

/// (joint covariance (n, n), staleness) of these variables from the factor of the last update.
py::tuple LiveCovarianceOf(LivingSolver& solver, const py::object& ids, const std::string& accuracy,
                           double tolerance, int max_iterations);

}  // namespace inceres::python
