// Compiled without precompiled headers: what it uses must come from this one include.
#include "inceres/inceres.h"

namespace inceres::test {

double CostByUmbrellaAlone() {
  FactorGraph graph;
  const double start[] = {1.0, 2.0};
  const VariableId x = graph.AddVariable(start, 2, Role::kFrame);
  const auto priors = graph.AddFamily(std::make_shared<DiagonalPriorFamily>(2));
  graph.AddFactor(priors, {{3.0, 4.0}, {1.0, 1.0}}, {x}, std::make_shared<HuberLoss>(10.0));
  const Summary batch = Solve(SolverOptions(), &graph);
  IncrementalSolver solver{IncrementalOptions()};
  GraphCovariance covariance;
  const bool complete = batch.IsSolutionUsable() && solver.graph().num_factors() == 0 &&
                        covariance.Compute(graph, {{x, x}}).ok() && INCERES_VERSION_MAJOR >= 0;
  return complete ? batch.final_cost : -1.0;
}

}  // namespace inceres::test
