#pragma once

#include <memory>

#include "inceres/problem/factor_graph.h"

namespace inceres::test {

/// Powell's singular function, start (3, −1, 0, 1), minimum 0 at 0, where J is singular. Four
/// variables of size 1; four families of one factor. Source: Powell, "An iterative method for
/// finding stationary values of a function of several variables", 1962.
void MakePowell(FactorGraph* graph);

/// Rosenbrock's function as least squares, ½((10 (y − x²))² + (1 − x)²), start (−1.2, 1), minimum 0
/// at (1, 1). One variable.
void MakeRosenbrock(FactorGraph* graph);

/// y = exp(m x + c) through 40 points with seeded noise around m = 0.3, c = 0.1, start (0, 0).
/// Variables m and c. With `outliers` every tenth point is off by 4.
void MakeCurveFit(FactorGraph* graph, std::shared_ptr<const Loss> loss = nullptr,
                  bool outliers = false);

}  // namespace inceres::test
