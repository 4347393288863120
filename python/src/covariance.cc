#include "covariance.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "watch.h"

namespace inceres::python {
namespace {

template <typename Enum>
using Names = std::vector<std::pair<const char*, Enum>>;

const Names<CovarianceAlgorithm> kAlgorithms = {{"schur", CovarianceAlgorithm::kSchur},
                                                {"qr", CovarianceAlgorithm::kQr},
                                                {"dense_svd", CovarianceAlgorithm::kDenseSvd}};
const Names<CovarianceAccuracy> kAccuracies = {{"as_factored", CovarianceAccuracy::kAsFactored},
                                               {"undamped", CovarianceAccuracy::kUndamped},
                                               {"exact", CovarianceAccuracy::kExact}};

template <typename Enum>
Enum OneOf(const std::string& option, const std::string& value, const Names<Enum>& names) {
  std::string all;
  for (const auto& [name, choice] : names) {
    if (value == name) {
      return choice;
    }
    all += (all.empty() ? "" : ", ") + std::string(name);
  }
  throw py::value_error(option + ": '" + value + "' is none of " + all);
}

CovarianceOptions ToOptions(const py::kwargs& given) {
  CovarianceOptions options;
  for (const auto& [key, value] : given) {
    const auto name = key.cast<std::string>();
    if (name == "num_threads") {
      options.num_threads = value.cast<int>();
    } else if (name == "max_inflation") {
      options.max_inflation = value.cast<double>();
    } else if (name == "algorithm") {
      options.algorithm = OneOf(name, value.cast<std::string>(), kAlgorithms);
    } else if (name == "min_column_remainder") {
      options.min_column_remainder = value.cast<double>();
    } else if (name == "null_space_rank") {
      options.null_space_rank = value.cast<int>();
    } else if (name == "min_reciprocal_condition_number") {
      options.min_reciprocal_condition_number = value.cast<double>();
    } else {
      throw py::type_error("unknown option '" + name +
                           "'; there are algorithm, max_inflation, min_column_remainder, "
                           "min_reciprocal_condition_number, null_space_rank, num_threads");
    }
  }
  Check(options.Validate());
  return options;
}

py::dict ToDict(const FactorStaleness& staleness) {
  py::dict result;
  result["num_stale_factors"] = staleness.num_stale_factors;
  result["largest_residual_error"] = staleness.largest_residual_error;
  result["num_dirty_factors"] = staleness.num_dirty_factors;
  result["num_changed_rows"] = staleness.num_changed_rows;
  result["largest_pending_step"] = staleness.largest_pending_step;
  result["frame_damping"] = staleness.frame_damping;
  result["landmark_damping"] = staleness.landmark_damping;
  result["damping_error"] = staleness.damping_error;
  result["num_iterations"] = staleness.num_iterations;
  result["num_factored_frames"] = staleness.num_factored_frames;
  return result;
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
  Check(CallWithoutGil(families, [&] { return compute(&covariance, pairs); }));
  py::array_t<double> blocks({static_cast<py::ssize_t>(rows.size()),
                              static_cast<py::ssize_t>(height), static_cast<py::ssize_t>(width)});
  double* to = blocks.mutable_data();
  for (std::size_t i = 0; i < rows.size(); ++i, to += height * width) {
    covariance.Get(rows[i], columns[i], to);
  }
  return std::move(blocks);
}

py::tuple LiveCovarianceOf(LivingSolver& solver, const py::object& ids, const std::string& accuracy,
                           double tolerance, int max_iterations) {
  const Occupation::Guard guard(&solver.occupation, "live_covariance");
  LiveCovarianceOptions options;
  options.accuracy = OneOf("accuracy", accuracy, kAccuracies);
  options.tolerance = tolerance;
  options.max_iterations = max_iterations;
  const std::vector<VariableId> variables = ToVariables(solver.core.graph(), ids, "ids");
  LiveCovariance covariance;
  Check(CallWithoutGil(solver.families,
                       [&] { return solver.core.Covariance(variables, options, &covariance); }));
  const auto size = static_cast<py::ssize_t>(covariance.size());
  py::array_t<double> joint({size, size});
  std::copy(covariance.values.begin(), covariance.values.end(), joint.mutable_data());
  return py::make_tuple(joint, ToDict(covariance.staleness));
}

}  // namespace inceres::python
