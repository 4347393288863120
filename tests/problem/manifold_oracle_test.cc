// Large steps against slow, obvious computations: matrix exponentials by their series, angles by
// scalar products.
#include <cmath>

#include <gtest/gtest.h>

#include "problem/manifold_cases.h"

namespace inceres {
namespace {

// Square matrices of up to 4×4, row-major, in long double.
using Square = std::vector<long double>;

Square Multiply(const Square& A, const Square& B, int n) {
  Square C(A.size(), 0.0L);
  for (int r = 0; r < n; ++r) {
    for (int k = 0; k < n; ++k) {
      for (int c = 0; c < n; ++c) {
        C[static_cast<std::size_t>(r * n + c)] +=
            A[static_cast<std::size_t>(r * n + k)] * B[static_cast<std::size_t>(k * n + c)];
      }
    }
  }
  return C;
}

Square Exponential(const Square& A, int n) {
  Square sum(A.size(), 0.0L);
  Square term(A.size(), 0.0L);
  for (int k = 0; k < n; ++k) {
    sum[static_cast<std::size_t>(k * n + k)] = term[static_cast<std::size_t>(k * n + k)] = 1.0L;
  }
  for (int order = 1; order < 60; ++order) {
    term = Multiply(term, A, n);
    for (std::size_t k = 0; k < A.size(); ++k) {
      term[k] /= order;
      sum[k] += term[k];
    }
  }
  return sum;
}

// The 4×4 matrix of a pose p, q.
Square PoseMatrix(const double* p, const double* q) {
  double R[9];
  QuaternionToMatrix(q, R);
  return {R[0], R[1], R[2], p[0], R[3], R[4], R[5], p[1],
          R[6], R[7], R[8], p[2], 0.0L, 0.0L, 0.0L, 1.0L};
}

Square TwistMatrix(const double* rho, const double* phi) {
  return {0.0L,    -phi[2], phi[1], rho[0], phi[2], 0.0L, -phi[0], rho[1],
          -phi[1], phi[0],  0.0L,   rho[2], 0.0L,   0.0L, 0.0L,    0.0L};
}

void ExpectEqual(const Square& actual, const Square& expected, double tolerance) {
  for (std::size_t k = 0; k < expected.size(); ++k) {
    ASSERT_NEAR(static_cast<double>(actual[k]), static_cast<double>(expected[k]), tolerance)
        << "entry " << k;
  }
}

constexpr double kOrigin[3] = {0.0, 0.0, 0.0};

TEST(ManifoldOracle, SE3IsTheMatrixExponential) {
  Random random(1);
  const SE3Manifold manifold;
  for (int k = 0; k < 300; ++k) {
    const std::vector<double> x = RandomPose(random);
    const std::vector<double> xi = RandomVector(random, 6, k % 3 == 0 ? 1e-3 : 2.5);
    double moved[7];
    ASSERT_TRUE(manifold.Plus(x.data(), xi.data(), moved));
    const Square expected = Multiply(PoseMatrix(x.data(), x.data() + 3),
                                     Exponential(TwistMatrix(xi.data(), xi.data() + 3), 4), 4);
    ExpectEqual(PoseMatrix(moved, moved + 3), expected, 1e-13);
  }
}

TEST(ManifoldOracle, PoseMovesRotationAndPositionApart) {
  Random random(2);
  const PoseManifold manifold;
  for (int k = 0; k < 300; ++k) {
    const std::vector<double> x = RandomPose(random);
    const std::vector<double> delta = RandomVector(random, 6, 2.5);
    double moved[7];
    ASSERT_TRUE(manifold.Plus(x.data(), delta.data(), moved));
    const Square turn = Exponential(TwistMatrix(kOrigin, delta.data() + 3), 4);
    ExpectEqual(PoseMatrix(kOrigin, moved + 3),
                Multiply(PoseMatrix(kOrigin, x.data() + 3), turn, 4), 1e-13);
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_EQ(moved[c], x[c] + delta[c]);
    }
  }
}

TEST(ManifoldOracle, LeftPoseTurnsOnTheLeft) {
  Random random(2);
  const LeftPoseManifold manifold;
  for (int k = 0; k < 300; ++k) {
    const std::vector<double> x = RandomPose(random);
    const std::vector<double> delta = RandomVector(random, 6, 2.5);
    double moved[7];
    ASSERT_TRUE(manifold.Plus(x.data(), delta.data(), moved));
    const Square turn = Exponential(TwistMatrix(kOrigin, delta.data() + 3), 4);
    ExpectEqual(PoseMatrix(kOrigin, moved + 3),
                Multiply(turn, PoseMatrix(kOrigin, x.data() + 3), 4), 1e-13);
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_EQ(moved[c], x[c] + delta[c]);
    }
  }
}

TEST(ManifoldOracle, RotationQuaternionTurnsOnTheRight) {
  Random random(3);
  const RotationQuaternionManifold manifold;
  for (int k = 0; k < 300; ++k) {
    const std::vector<double> q = RandomQuaternion(random);
    const std::vector<double> phi = RandomVector(random, 3, 3.0);
    double moved[4];
    ASSERT_TRUE(manifold.Plus(q.data(), phi.data(), moved));
    const Square turn = Exponential(TwistMatrix(kOrigin, phi.data()), 4);
    ExpectEqual(PoseMatrix(kOrigin, moved), Multiply(PoseMatrix(kOrigin, q.data()), turn, 4),
                1e-13);
  }
}

TEST(ManifoldOracle, QuaternionTurnsOnTheLeftByTwiceTheAngle) {
  Random random(4);
  for (int k = 0; k < 300; ++k) {
    const std::vector<double> q = RandomQuaternion(random);
    const std::vector<double> delta = RandomVector(random, 3, 1.5);
    const double twice[3] = {2.0 * delta[0], 2.0 * delta[1], 2.0 * delta[2]};
    const Square expected =
        Multiply(Exponential(TwistMatrix(kOrigin, twice), 4), PoseMatrix(kOrigin, q.data()), 4);
    double moved[4];
    ASSERT_TRUE(EigenQuaternionManifold().Plus(q.data(), delta.data(), moved));
    ExpectEqual(PoseMatrix(kOrigin, moved), expected, 1e-13);
    const double scalar_first[4] = {q[3], q[0], q[1], q[2]};
    double w_first[4];
    ASSERT_TRUE(QuaternionManifold().Plus(scalar_first, delta.data(), w_first));
    const double moved_again[4] = {w_first[1], w_first[2], w_first[3], w_first[0]};
    ExpectEqual(PoseMatrix(kOrigin, moved_again), expected, 1e-13);
  }
}

TEST(ManifoldOracle, SE2IsTheMatrixExponential) {
  Random random(5);
  const SE2Manifold manifold;
  const auto pose = [](const double* x) {
    return Square{std::cos(x[2]),
                  -std::sin(x[2]),
                  x[0],
                  std::sin(x[2]),
                  std::cos(x[2]),
                  x[1],
                  0.0L,
                  0.0L,
                  1.0L};
  };
  for (int k = 0; k < 300; ++k) {
    const std::vector<double> x = RandomVector(random, 3, 3.0);
    const std::vector<double> xi = RandomVector(random, 3, k % 3 == 0 ? 1e-5 : 3.0);
    double moved[3];
    ASSERT_TRUE(manifold.Plus(x.data(), xi.data(), moved));
    const Square twist = {0.0L, -xi[2], xi[0], xi[2], 0.0L, xi[1], 0.0L, 0.0L, 0.0L};
    ExpectEqual(pose(moved), Multiply(pose(x.data()), Exponential(twist, 3), 3), 1e-13);
  }
}

// After whole turns V(ω) is zero but for rounding, and beside them as small as they are near.
TEST(ManifoldOracle, SE2HasNoDifferenceOverWholeTurns) {
  const SE2Manifold manifold;
  const double x[3] = {0.2, -0.1, 0.0};
  double delta[3];
  for (const int turns : {-3, -1, 1, 2, 100}) {
    const double y[3] = {1.0, 0.5, 2.0 * M_PI * turns};
    EXPECT_FALSE(manifold.Minus(y, x, delta)) << turns;
  }
  const double y[3] = {1.0, 0.5, 2.0 * M_PI - 1e-4};
  double moved[3];
  ASSERT_TRUE(manifold.Minus(y, x, delta));
  ASSERT_TRUE(manifold.Plus(x, delta, moved));
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(moved[k], y[k], 1e-9);
  }
}

TEST(ManifoldOracle, SphereKeepsTheNormAndTurnsByTheStep) {
  Random random(6);
  for (const int n : {2, 3, 4, 7}) {
    const SphereManifold manifold(n);
    for (int k = 0; k < 200; ++k) {
      std::vector<double> x = RandomVector(random, n);
      x.back() = k % 4 == 0 ? 0.0 : x.back();  // on the seam between the two reflections
      const std::vector<double> delta = RandomVector(random, n - 1, 1.0 / n);
      std::vector<double> moved(x.size());
      ASSERT_TRUE(manifold.Plus(x.data(), delta.data(), moved.data()));
      double norm = 0.0, moved_norm = 0.0, step = 0.0, chord = 0.0;
      for (std::size_t i = 0; i < x.size(); ++i) {
        norm = std::hypot(norm, x[i]);
        moved_norm = std::hypot(moved_norm, moved[i]);
        chord = std::hypot(chord, moved[i] - x[i]);
        step = i + 1 < x.size() ? std::hypot(step, delta[i]) : step;
      }
      EXPECT_NEAR(moved_norm, norm, 1e-14 * norm);
      EXPECT_NEAR(chord, 2.0 * norm * std::sin(0.5 * step), 1e-14 * norm);
    }
  }
}

TEST(ManifoldOracle, SphereWorksAtExtremeScales) {
  for (const double scale : {1e-200, 1e200}) {
    const double x[3] = {scale, 2.0 * scale, -2.0 * scale};
    const double delta[2] = {0.3, 0.4};
    double moved[3];
    ASSERT_TRUE(SphereManifold(3).Plus(x, delta, moved));
    const double dot = (x[0] / scale) * (moved[0] / scale) + (x[1] / scale) * (moved[1] / scale) +
                       (x[2] / scale) * (moved[2] / scale);
    EXPECT_NEAR(dot / 9.0, std::cos(0.5), 1e-15);
  }
}

}  // namespace
}  // namespace inceres
