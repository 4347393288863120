// Minimizes ½ (10 − x)² with ceres::Solve, from an installation whose drop-in stands in front of
// Ceres.
#include <cmath>
#include <cstdio>

#include <ceres/ceres.h>
#include <inceres/ceres/dropin.h>

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
  ceres::Solve(ceres::Solver::Options(), &problem, &summary);
  std::printf("x = %.9g, solved %lld times by inceres\n", x, inceres_dropin_num_solves());
  return inceres_dropin_num_solves() == 1 && std::abs(x - 10.0) < 1e-3 ? 0 : 1;
}
