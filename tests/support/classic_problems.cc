#include "support/classic_problems.h"

#include <cmath>
#include <memory>
#include <utility>

#include "inceres/autodiff/autodiff_family.h"
#include "support/classic_functors.h"
#include "support/random_values.h"

namespace inceres::test {

void MakePowell(FactorGraph* graph) {
  VariableId x[4];
  for (int k = 0; k < 4; ++k) {
    x[k] = graph->AddVariable(&PowellTerm::kStart[k], 1, Role::kFrame);
  }
  for (int term = 0; term < 4; ++term) {
    const auto [a, b] = PowellTerm::kVariables[term];
    const auto family = graph->AddFamily(
        std::make_shared<AutoDiffFamily<PowellTerm, 1, 1, 1>>("term of Powell's function"));
    graph->AddFactor(family, {term}, {x[a], x[b]});
  }
}

void MakeRosenbrock(FactorGraph* graph) {
  const double start[2] = {-1.2, 1.0};
  const auto family =
      graph->AddFamily(std::make_shared<AutoDiffFamily<RosenbrockTerm, 2, 2>>("valley"));
  graph->AddFactor(family, {}, {graph->AddVariable(start, 2, Role::kFrame)});
}

void MakeCurveFit(FactorGraph* graph, std::shared_ptr<const Loss> loss, bool outliers) {
  Random random(7);
  const double zero = 0.0;
  const VariableId m = graph->AddVariable(&zero, 1, Role::kFrame);
  const VariableId c = graph->AddVariable(&zero, 1, Role::kFrame);
  const auto family =
      graph->AddFamily(std::make_shared<AutoDiffFamily<ExponentialTerm, 1, 1, 1>>("curve point"));
  for (int i = 0; i < 40; ++i) {
    const double x = 0.125 * i;
    const double y =
        std::exp(0.3 * x + 0.1) + 0.2 * random.Unit() + (outliers && i % 10 == 4 ? 4.0 : 0.0);
    graph->AddFactor(family, {x, y}, {m, c}, loss);
  }
}

}  // namespace inceres::test
