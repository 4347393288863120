// Minimizes ½ (x − 3)² with inceres::core from an installation.
#include <cmath>
#include <cstdio>
#include <memory>

#include <inceres/problem/ambient_family.h>
#include <inceres/solver/solver.h>

class Offset : public inceres::AmbientFamily<Offset> {
 public:
  Offset() : AmbientFamily(1, {{1, 1}}) {}
  int size() const override { return 1; }
  const char* Name() const override { return "offset"; }
  bool EvaluateOne(int /*i*/, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    residuals[0] = parameters[0][0] - 3.0;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = 1.0;
    }
    return true;
  }
};

int main() {
  inceres::FactorGraph graph;
  const double start = 10.0;
  const inceres::VariableId x = graph.AddVariable(&start, 1, inceres::Role::kFrame);
  graph.Connect(graph.AddFamily(std::make_shared<Offset>()), &x);
  const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
  std::printf("x = %.9g: %s\n", *graph.Values(x), summary.message.c_str());
  return summary.IsSolutionUsable() && std::abs(*graph.Values(x) - 3.0) < 1e-6 ? 0 : 1;
}
