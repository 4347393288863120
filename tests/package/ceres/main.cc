// Minimizes ½ (10 − x)² through the Ceres shim from an installation: Ceres's own hello-world with
// another namespace.
#include <cmath>
#include <cstdio>

#include <ceres/ceres.h>
#include <inceres/ceres/solve.h>

struct Offset {
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    residual[0] = 10.0 - x[0];
    return true;
  }
};

int main() {
  double x = 0.5;
  ceres::Problem problem;
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Offset, 1, 1>(new Offset), nullptr, &x);
  ceres::Solver::Summary summary;
  inceres::SolveReport report;
  inceres::Solve(ceres::Solver::Options(), &problem, &summary, {}, &report);
  std::printf("x = %.9g, %s\n%s\n", x, report.used_stock ? "by stock Ceres" : "by inceres",
              summary.BriefReport().c_str());
  return summary.IsSolutionUsable() && !report.used_stock && std::abs(x - 10.0) < 1e-3 ? 0 : 1;
}
