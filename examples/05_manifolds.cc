// Lesson 5, manifolds: how a camera is turned on a vehicle, from directions both have seen; on a
// built-in manifold, without any, and on one of your own.
//
//     05_manifolds
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <vector>

#include "inceres/problem/ambient_family.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"

namespace {

struct Directions {
  double vehicle[3];
  double camera[3];
};

// residual = R(q) camera − vehicle, of a quaternion q (x, y, z, w). The tangent size is that of the
// manifold: the family writes derivatives by the four numbers, the solver makes tangent ones of it.
class DirectionFamily : public inceres::AmbientFamily<DirectionFamily> {
 public:
  using Measurement = Directions;
  explicit DirectionFamily(int tangent_size) : AmbientFamily(3, {{4, tangent_size}}) {}

  void Add(const Directions& seen) { directions_.push_back(seen); }
  int size() const override { return static_cast<int>(directions_.size()); }
  const char* Name() const override { return "direction"; }

  // R(q) v = v + 2 w (u × v) + 2 u × (u × v) with q = (u, w).
  bool EvaluateOne(int i, const double* const* x, double* residual, double** J) const {
    const Directions& seen = directions_[static_cast<std::size_t>(i)];
    const double *u = x[0], *v = seen.camera, w = x[0][3];
    double u_v[3], u_u_v[3];
    inceres::Cross(u, v, u_v);
    inceres::Cross(u, u_v, u_u_v);
    const double dot = u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    const double cross[9] = {0, v[2], -v[1], -v[2], 0, v[0], v[1], -v[0], 0};  // ∂(u × v)/∂u
    for (int r = 0; r < 3; ++r) {
      residual[r] = v[r] + 2.0 * (w * u_v[r] + u_u_v[r]) - seen.vehicle[r];
      for (int c = 0; J != nullptr && J[0] != nullptr && c < 3; ++c) {
        const double diagonal = r == c ? dot : 0.0;
        J[0][4 * r + c] = 2.0 * (w * cross[3 * r + c] + diagonal + u[r] * v[c] - 2.0 * v[r] * u[c]);
        J[0][4 * r + 3] = 2.0 * u_v[r];
      }
    }
    return true;
  }

 private:
  std::vector<Directions> directions_;
};

// [quoted in docs/lessons/05_manifolds.md]
// A quaternion that only turns about z: one degree of freedom.
class YawManifold final : public inceres::Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* q, const double* delta, double* q_plus_delta) const override {
    const double c = std::cos(0.5 * delta[0]), s = std::sin(0.5 * delta[0]);
    const double x = q[0], y = q[1], z = q[2], w = q[3];  // q and q_plus_delta may be one array
    q_plus_delta[0] = c * x - s * y;                      // (0, 0, s, c) ⊗ q
    q_plus_delta[1] = c * y + s * x;
    q_plus_delta[2] = c * z + s * w;
    q_plus_delta[3] = c * w - s * z;
    return true;
  }
  bool PlusJacobian(const double* q, double* J) const override {  // by delta, at 0: 4 × 1
    J[0] = -0.5 * q[1];
    J[1] = 0.5 * q[0];
    J[2] = 0.5 * q[3];
    J[3] = -0.5 * q[2];
    return true;
  }
};
// [end of quote]

// The turn from a to b in degrees, whatever the lengths of the quaternions.
double Degrees(const double* a, const double* b) {
  double inverse[4], difference[4], phi[3];
  inceres::ConjugateQuaternion(a, inverse);
  inceres::MultiplyQuaternions(inverse, b, difference);
  inceres::LogQuaternion(difference, phi);
  return std::hypot(phi[0], phi[1], phi[2]) * 180.0 / M_PI;
}

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
  const double length = std::hypot(std::hypot(found[0], found[1]), std::hypot(found[2], found[3]));
  std::printf("%-28s %3d %11d %8.4f %8.2f deg\n", name, graph.TangentSize(q),
              summary.num_successful_steps, length, Degrees(found, truth));
}

}  // namespace

int main() {
  const double turn[3] = {0.0, 0.0, 1.9};  // about z, which a mechanic may know
  double truth[4], R[9];
  inceres::ExpQuaternion(turn, truth);
  inceres::QuaternionToMatrix(truth, R);
  std::vector<Directions> seen;
  for (int i = 0; i < 12; ++i) {
    Directions pair = {{}, {std::cos(i), std::sin(2.0 * i), std::sin(i)}};
    inceres::MultiplyMatrixVector(R, pair.camera, pair.vehicle);
    pair.vehicle[i % 3] += i % 2 == 0 ? 0.01 : -0.01;  // what was measured is not exact
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
