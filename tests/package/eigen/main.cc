// A variable from an Eigen vector, seen again as one.
#include <cstdio>

#include <inceres/eigen.h>

int main() {
  inceres::FactorGraph graph;
  const inceres::VariableId x =
      inceres::AddVariable(&graph, Eigen::Vector3d(1.0, 2.0, 3.0), inceres::Role::kLandmark);
  const double sum = inceres::ValuesOf<3>(graph, x).sum();
  std::printf("sum = %g\n", sum);
  return sum == 6.0 ? 0 : 1;
}
