#include "support/classic_problems.h"

#include <cmath>
#include <utility>
#include <vector>

#include "support/test_families.h"

namespace inceres::test {
namespace {

// A factor in two variables of size 1: residual and its two derivatives.
template <typename F, typename DA, typename DB>
void AddScalarPair(FactorGraph* graph, VariableId a, VariableId b, F f, DA df_da, DB df_db) {
  graph->AddFactor(graph->AddFamily(ScalarFamily(f, df_da, df_db)), 0, {a, b});
}

}  // namespace

void MakePowell(FactorGraph* graph) {
  const double start[4] = {3.0, -1.0, 0.0, 1.0};
  VariableId x[4];
  for (int k = 0; k < 4; ++k) {
    x[k] = graph->AddVariable(start + k, 1, Role::kFrame);
  }
  AddScalarPair(
      graph, x[0], x[1], [](double a, double b) { return a + 10.0 * b; }, 1.0, 10.0);
  AddScalarPair(
      graph, x[2], x[3], [](double a, double b) { return std::sqrt(5.0) * (a - b); },
      std::sqrt(5.0), -std::sqrt(5.0));
  AddScalarPair(
      graph, x[1], x[2], [](double a, double b) { return (a - 2.0 * b) * (a - 2.0 * b); },
      [](double a, double b) { return 2.0 * (a - 2.0 * b); },
      [](double a, double b) { return -4.0 * (a - 2.0 * b); });
  AddScalarPair(
      graph, x[0], x[3], [](double a, double b) { return std::sqrt(10.0) * (a - b) * (a - b); },
      [](double a, double b) { return 2.0 * std::sqrt(10.0) * (a - b); },
      [](double a, double b) { return -2.0 * std::sqrt(10.0) * (a - b); });
}

void MakeRosenbrock(FactorGraph* graph) {
  const double start[2] = {-1.2, 1.0};
  const VariableId x = graph->AddVariable(start, 2, Role::kFrame);
  const auto function = [](int, const double* const* parameters, double* residuals,
                           double** jacobians) {
    const double* p = parameters[0];
    residuals[0] = 10.0 * (p[1] - p[0] * p[0]);
    residuals[1] = 1.0 - p[0];
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      const double J[4] = {-20.0 * p[0], 10.0, -1.0, 0.0};
      std::copy(J, J + 4, jacobians[0]);
    }
    return true;
  };
  auto family =
      std::make_shared<FunctionFamily>(2, std::vector<FactorFamily::Slot>{{2, 2}}, function);
  graph->AddFactor(graph->AddFamily(family), 0, {x});
}

void MakeCurveFit(FactorGraph* graph, std::shared_ptr<const Loss> loss, bool outliers) {
  Random random(7);
  std::vector<std::pair<double, double>> points;
  for (int i = 0; i < 40; ++i) {
    const double x = 0.125 * i;
    points.emplace_back(
        x, std::exp(0.3 * x + 0.1) + 0.2 * random.Unit() + (outliers && i % 10 == 4 ? 4.0 : 0.0));
  }
  const double zero = 0.0;
  const VariableId m = graph->AddVariable(&zero, 1, Role::kFrame);
  const VariableId c = graph->AddVariable(&zero, 1, Role::kFrame);
  const auto function = [points](int i, const double* const* parameters, double* residuals,
                                 double** jacobians) {
    const auto [x, y] = points[static_cast<std::size_t>(i)];
    const double model = std::exp(parameters[0][0] * x + parameters[1][0]);
    residuals[0] = y - model;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = -x * model;
    }
    if (jacobians != nullptr && jacobians[1] != nullptr) {
      jacobians[1][0] = -model;
    }
    return true;
  };
  const auto family = graph->AddFamily(std::make_shared<FunctionFamily>(
      1, std::vector<FactorFamily::Slot>{{1, 1}, {1, 1}}, function));
  for (std::size_t i = 0; i < points.size(); ++i) {
    graph->AddFactor(family, 0, {m, c}, loss);
  }
}

}  // namespace inceres::test
