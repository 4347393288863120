#include "covariance.h"

#include <string>

#include "watch.h"

namespace inceres::python {
namespace {

CovarianceOptions ToOptions(const py::kwargs& given) {
  CovarianceOptions options;
  for (const auto& [key, value] : given) {
    const auto name = key.cast<std::string>();
    if (name == "num_threads") {
      options.num_threads = value.cast<int>();
    } else if (name == "max_inflation") {
      options.max_inflation = value.cast<double>();
    } else {
      throw py::type_error("unknown option '" + name + "'; there are max_inflation, num_threads");
    }
  }
  Check(options.Validate());
  return options;
}

// The tangent size of all of them.
int CommonTangentSize(const FactorGraph& graph, const std::vector<VariableId>& ids,
                      const char* name) {
  for (const VariableId id : ids) {
    if (graph.TangentSize(id) != graph.TangentSize(ids[0])) {
      throw py::value_error(std::string(name) + ": variables " + std::to_string(ids[0]) + " and " +
                            std::to_string(id) +
                            " have different tangent sizes; ask for them in "
                            "calls of their own");
    }
  }
  return ids.empty() ? 0 : graph.TangentSize(ids[0]);
}

}  // namespace

py::array CovarianceOf(const FactorGraph& graph, const Families& families, const py::object& a,
                       const py::object& b, const py::kwargs& options,
                       const ComputeCovariance& compute) {
  const std::vector<VariableId> rows = ToVariables(graph, a, "a");
  const std::vector<VariableId> columns = b.is_none() ? rows : ToVariables(graph, b, "b");
  if (rows.size() != columns.size()) {
    throw py::value_error("b: " + std::to_string(columns.size()) + " ids, a has " +
                          std::to_string(rows.size()));
  }
  const int height = CommonTangentSize(graph, rows, "a");
  const int width = CommonTangentSize(graph, columns, "b");
  GraphCovariance::Pairs pairs;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    pairs.emplace_back(rows[i], columns[i]);
  }
  GraphCovariance covariance(ToOptions(options));
  Watch watch(py::none(), families);
  Status status;
  {
    const py::gil_scoped_release no_gil;
    status = compute(&covariance, pairs);
  }
  if (watch.Finish()) {
    watch.RaiseInterrupted(py::dict());
  }
  Check(status);
  py::array_t<double> blocks({static_cast<py::ssize_t>(rows.size()),
                              static_cast<py::ssize_t>(height), static_cast<py::ssize_t>(width)});
  double* to = blocks.mutable_data();
  for (std::size_t i = 0; i < rows.size(); ++i, to += height * width) {
    covariance.Get(rows[i], columns[i], to);
  }
  return std::move(blocks);
}

}  // namespace inceres::python
