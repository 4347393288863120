// Lesson 5, manifolds: how a camera is turned on a vehicle, from directions both have seen; on a
// built-in manifold, without any, and on one of your own.
//
//     05_manifolds
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "examples/directions.h"
#include "examples/noise.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"

namespace {

// [quoted in docs/lessons/05_manifolds.md]
// A quaternion that only turns about z: one degree of freedom.
class YawManifold final : public inceres::Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* q, const double* delta, double* q_plus_delta) const override {
    const double c = std::cos(0.5 * delta[0]), s = std::sin(0.5 * delta[0]);
    const double turned[4] = {c * q[0] - s * q[1], c * q[1] + s * q[0], c * q[2] + s * q[3],
                              c * q[3] - s * q[2]};
    std::copy_n(turned, 4, q_plus_delta);  // (0, 0, s, c) ⊗ q
    return true;
  }
  bool PlusJacobian(const double* q, double* J) const override {  // by delta, at 0: 4 × 1
    const double dq[4] = {-0.5 * q[1], 0.5 * q[0], 0.5 * q[3], -0.5 * q[2]};
    std::copy_n(dq, 4, J);
    return true;
  }
};
// [end of quote]

void Run(const char* name, const std::vector<Directions>& seen, const double* truth,
         const std::shared_ptr<const inceres::Manifold>& manifold) {
  // [quoted in docs/lessons/05_manifolds.md]
  inceres::FactorGraph graph;
  const double identity[4] = {0.0, 0.0, 0.0, 1.0};
  const auto q = graph.AddVariable(identity, 4, inceres::Role::kFrame, manifold);
  const auto family = graph.AddFamily(std::make_shared<DirectionFamily>(graph.TangentSize(q)));
  for (const Directions& pair : seen) {
    graph.AddFactor(family, pair, {q});
  }
  const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
  // [end of quote]
  const double* found = graph.Values(q);
  double phi[3] = {};  // the turn from one to the other
  const bool known = inceres::RotationQuaternionManifold().Minus(found, truth, phi);
  std::printf("%-28s %3d %11d %8.4f %8.2f deg\n", name, graph.TangentSize(q),
              summary.num_successful_steps,
              std::hypot(std::hypot(found[0], found[1]), std::hypot(found[2], found[3])),
              known ? std::hypot(phi[0], phi[1], phi[2]) * 180.0 / M_PI : 180.0);
}

}  // namespace

int main() {
  const double turn[3] = {0.0, 0.0, 1.9};  // about z, which a mechanic may know
  double truth[4], R[9];
  inceres::ExpQuaternion(turn, truth);
  inceres::QuaternionToMatrix(truth, R);
  std::vector<Directions> seen;
  Noise noise(5);
  for (int i = 0; i < 12; ++i) {
    Directions pair = {{}, {std::cos(i), std::sin(2.0 * i), std::sin(i)}};
    inceres::MultiplyMatrixVector(R, pair.camera, pair.vehicle);
    for (double& value : pair.vehicle) {
      value += noise.Normal(0.02);
    }
    seen.push_back(pair);
  }
  std::printf("%-28s %3s %11s %8s %12s\n", "manifold", "dof", "iterations", "length", "off by");
  Run("RotationQuaternionManifold", seen, truth,
      std::make_shared<inceres::RotationQuaternionManifold>());
  Run("SphereManifold(4)", seen, truth, std::make_shared<inceres::SphereManifold>(4));
  Run("none", seen, truth, nullptr);
  Run("YawManifold, our own", seen, truth, std::make_shared<YawManifold>());
  return 0;
}
