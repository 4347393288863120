// A variable from an Eigen vector, seen again as one; and an Eigen vector of Jets.
#include <cstdio>

#include <inceres/autodiff/jet_eigen.h>
#include <inceres/eigen.h>

int main() {
  inceres::FactorGraph graph;
  const inceres::VariableId x =
      inceres::AddVariable(&graph, Eigen::Vector3d(1.0, 2.0, 3.0), inceres::Role::kLandmark);
  const double sum = inceres::ValuesOf<3>(graph, x).sum();
  std::printf("sum = %g\n", sum);
  using Jet = inceres::Jet<1>;
  const Eigen::Matrix<Jet, 2, 1> jets(Jet(3.0, 0), Jet(4.0));
  return sum == 6.0 && jets.norm().a == 5.0 ? 0 : 1;
}
