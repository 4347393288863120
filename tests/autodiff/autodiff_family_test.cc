// AutoDiffFamily in graphs: the same factors as built-in families, by functors.

#include "inceres/autodiff/autodiff_family.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/check_jacobians.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/solver.h"
#include "support/random_values.h"

namespace inceres {
namespace {

// A landmark seen from a pose [t, q = (x, y, z, w)], which may be the very rotation by 0.
struct SightFunctor {
  template <typename T>
  bool operator()(const T* pose, const T* point, T* residuals) const {
    const T* q = pose + 3;
    const T d[3] = {point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]};
    // R(q)ᵀ d = d + 2 w (d × v) + 2 (d × v) × v, v = (x, y, z)
    T u[3], s[3];
    Cross(d, q, u);
    Cross(u, q, s);
    T p[3];
    for (int k = 0; k < 3; ++k) {
      p[k] = d[k] + 2.0 * (q[3] * u[k] + s[k]);
    }
    if (p[2] < 0.1) {
      return false;
    }
    residuals[0] = p[0] / p[2] - x;
    residuals[1] = p[1] / p[2] - y;
    return true;
  }
  template <typename T>
  static void Cross(const T* a, const T* b, T* c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
  }
  double x = 0.0, y = 0.0;
};
using Sights = AutoDiffFamily<SightFunctor, 2, 7, 3>;

// Poses on a line, landmarks before them, exact measurements; the landmarks start elsewhere.
struct SightWorld {
  SightWorld() : sights(graph.AddFamily(std::make_shared<Sights>("sight", kTangentSizes))) {
    test::Random random(41);
    const auto manifold = std::make_shared<PoseManifold>();
    for (int f = 0; f < 3; ++f) {
      const double pose[7] = {0.5 * f, 0.1 * f, 0.0, 0.0, 0.0, 0.0, 1.0};
      frames.push_back(graph.AddVariable(pose, 7, Role::kFrame, manifold));
      graph.SetConstant(frames.back(), f < 2);
    }
    for (int l = 0; l < 20; ++l) {
      const double point[3] = {2.0 * random.Unit(), 2.0 * random.Unit(), 5.0 + random.Unit()};
      const double start[3] = {point[0] + 0.1, point[1] - 0.1, point[2] + 0.3};
      landmarks.push_back(graph.AddVariable(start, 3, Role::kLandmark));
      for (int f = 0; f < 3; ++f) {
        const double z = point[2];
        graph.AddFactor(sights, {(point[0] - 0.5 * f) / z, (point[1] - 0.1 * f) / z},
                        {frames[static_cast<std::size_t>(f)], landmarks.back()});
      }
    }
  }
  static constexpr Sights::TangentSizes kTangentSizes = {6, 3};
  FactorGraph graph;
  FamilyHandle<Sights> sights;
  std::vector<VariableId> frames, landmarks;
};

TEST(AutoDiffFamily, JacobiansAreTheDerivatives) {
  const SightWorld world;
  const JacobianReport report = CheckJacobians(world.graph);
  EXPECT_TRUE(report.ok()) << report.ToString();
  EXPECT_EQ(report.num_factors, 60);
  EXPECT_EQ(report.num_entries, 60 * 2 * 9);
}

TEST(AutoDiffFamily, IsSolvedWith) {
  SightWorld world;
  const Summary summary = Solve(SolverOptions(), &world.graph);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_LT(summary.final_cost, 1e-12 * summary.initial_cost);
}

TEST(AutoDiffFamily, SameBitsForAnyNumberOfThreads) {
  std::vector<double> first;
  for (const int threads : {1, 2, 4}) {
    SightWorld world;
    SolverOptions options;
    options.num_threads = threads;
    Solve(options, &world.graph);
    std::vector<double> values;
    for (const VariableId id : world.landmarks) {
      values.insert(values.end(), world.graph.Values(id), world.graph.Values(id) + 3);
    }
    if (first.empty()) {
      first = values;
    }
    EXPECT_EQ(std::memcmp(first.data(), values.data(), first.size() * sizeof(double)), 0);
  }
}

TEST(AutoDiffFamily, AFactorThatFailsIsNamed) {
  SightWorld world;
  const double behind[3] = {0.0, 0.0, -1.0};
  world.graph.SetValues(world.landmarks[4], behind);
  const Summary summary = Solve(SolverOptions(), &world.graph);
  EXPECT_FALSE(summary.IsSolutionUsable());
  EXPECT_NE(summary.detail.find("sight"), std::string::npos) << summary.detail;
  EXPECT_NE(summary.detail.find("12"), std::string::npos) << summary.detail;  // 4 · 3
}

TEST(AutoDiffFamily, FunctorsAreReplaced) {
  Sights family;
  family.Reserve(2);
  family.Add({1.0, 2.0});
  family.Place(0, {3.0, 4.0});
  family.Place(1, {5.0, 6.0});
  family.Place(7, {7.0, 8.0});  // beyond the end: refused
  ASSERT_EQ(family.size(), 2);
  EXPECT_EQ(family.at(0).x, 3.0);
  EXPECT_EQ(family.at(1).y, 6.0);
  EXPECT_EQ(family.slot(0).tangent_size, 7);
}

struct SquaresFunctor {
  template <typename T>
  bool operator()(const T* x, T* residuals) const {
    for (int r = 0; r < count; ++r) {
      residuals[r] = x[0] * x[1] - 1.0 * r;
    }
    return true;
  }
  int count = 3;
};

TEST(AutoDiffFamily, TheNumberOfResidualsMayBeSaidAtRunTime) {
  AutoDiffFamily<SquaresFunctor, kDynamicResiduals, 2> family(3, "squares");
  family.Add({3});
  EXPECT_EQ(family.residual_size(), 3);
  const double x[2] = {2.0, 5.0};
  const double* parameters[] = {x};
  double residuals[3];
  double jacobian[6];
  double* jacobians[] = {jacobian};
  ASSERT_TRUE(family.EvaluateOne(0, parameters, residuals, jacobians));
  for (int r = 0; r < 3; ++r) {
    EXPECT_EQ(residuals[r], 10.0 - r);
    EXPECT_EQ(jacobian[2 * r], 5.0);
    EXPECT_EQ(jacobian[2 * r + 1], 2.0);
  }
}

}  // namespace
}  // namespace inceres
