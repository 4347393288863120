#include "inceres/problem/rotation.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace inceres {
namespace {

// The series themselves, in long double: sinc, cosc, sinq = Σ (−θ²)ᵏ / (2k + 1)!, (2k + 2)!, (2k +
// 3)!.
long double Series(double theta_squared, int first) {
  long double term = 1.0L;
  for (int k = 2; k <= first; ++k) {
    term /= k;
  }
  long double sum = 0.0L;
  for (int k = first; k < 120; k += 2) {
    sum += term;
    term *= -static_cast<long double>(theta_squared) / ((k + 1) * (k + 2));
  }
  return sum;
}

TEST(Rotation, CoefficientsAgreeWithTheirSeries) {
  for (double theta = 1e-9; theta < 6.0; theta *= 1.07) {
    const double t = theta * theta;
    const RotationCoefficients k = CoefficientsOfAngle(t);
    EXPECT_NEAR(k.sinc, static_cast<double>(Series(t, 1)), 1e-15) << theta;
    EXPECT_NEAR(k.cosc, static_cast<double>(Series(t, 2)), 5e-16) << theta;
    EXPECT_NEAR(k.sinq, static_cast<double>(Series(t, 3)), 5e-16) << theta;
    EXPECT_NEAR(Sinc(t, theta), static_cast<double>(Series(t, 1)), 1e-15) << theta;
  }
}

TEST(Rotation, CoefficientsAtZero) {
  const RotationCoefficients k = CoefficientsOfAngle(0.0);
  EXPECT_EQ(k.sinc, 1.0);
  EXPECT_EQ(k.cosc, 0.5);
  EXPECT_EQ(k.sinq, 1.0 / 6.0);
  EXPECT_EQ(Sinc(0.0, 0.0), 1.0);
}

TEST(Rotation, CoefficientsOfAFullTurn) {
  const double theta = 2.0 * M_PI;
  const RotationCoefficients k = CoefficientsOfAngle(theta * theta);
  EXPECT_NEAR(k.sinc, 0.0, 1e-16);
  EXPECT_NEAR(k.cosc, 0.0, 1e-30);
}

// Exp(φ + δ) = Exp(J_l(φ) δ) Exp(φ) to first order: the left Jacobian by central differences of the
// rotation matrix.
TEST(Rotation, LeftJacobianIsTheDerivativeOfExp) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  constexpr double kStep = 1e-5;
  for (int n = 0; n < 1000; ++n) {
    const double size = n % 4 == 0 ? 1e-8 : 2.5;
    const double phi[3] = {size * uniform(random), size * uniform(random), size * uniform(random)};
    const double v[3] = {uniform(random), uniform(random), uniform(random)};
    const auto turned = [&v](const double* w, double* y) {
      const RotationCoefficients k = CoefficientsOfAngle(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
      double R[9];
      RotationPolynomial(w, k.sinc, k.cosc, R);
      MultiplyMatrixVector(R, v, y);
    };
    const RotationCoefficients k =
        CoefficientsOfAngle(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]);
    double J_l[9];
    double y[3];
    RotationPolynomial(phi, k.cosc, k.sinq, J_l);
    turned(phi, y);
    for (int c = 0; c < 3; ++c) {
      double w[3] = {phi[0], phi[1], phi[2]};
      double forward[3], backward[3], analytic[3];
      w[c] = phi[c] + kStep;
      turned(w, forward);
      w[c] = phi[c] - kStep;
      turned(w, backward);
      const double column[3] = {J_l[c], J_l[3 + c], J_l[6 + c]};
      Cross(column, y, analytic);
      for (int r = 0; r < 3; ++r) {
        ASSERT_NEAR(analytic[r], (forward[r] - backward[r]) / (2.0 * kStep), 1e-9);
      }
    }
  }
}

TEST(Rotation, LogInvertsExp) {
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  for (const double angle :
       {0.0, 1e-300, 1e-160, 1e-30, 1e-9, 1e-3, 0.5, 1.5, 3.0, M_PI - 1e-7, M_PI - 1e-12}) {
    for (int n = 0; n < 50; ++n) {
      double phi[3] = {normal(random), normal(random), normal(random)};
      const double norm = std::sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]);
      double q[4];
      double back[3];
      for (double& value : phi) {
        value *= angle / norm;
      }
      ExpQuaternion(phi, q);
      EXPECT_NEAR(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], 1.0, 1e-15);
      LogQuaternion(q, back);
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(back[k], phi[k], 4e-15 * angle) << angle;
      }
      const double opposite[4] = {-q[0], -q[1], -q[2], -q[3]};
      LogQuaternion(opposite, back);
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(back[k], phi[k], 4e-15 * angle) << angle;
      }
    }
  }
}

// J_l⁻¹ = I − ½[φ]× + c[φ]×² undoes J_l; across the switch from the series to the closed form.
TEST(Rotation, InverseLeftJacobianInvertsTheLeftJacobian) {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int n = 0; n < 1000; ++n) {
    const double size = n % 4 == 0 ? 0.08 : n % 4 == 1 ? 1e-8 : 1.8;
    const double phi[3] = {size * uniform(random), size * uniform(random), size * uniform(random)};
    const RotationCoefficients k =
        CoefficientsOfAngle(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]);
    double J[9], J_inverse[9];
    RotationPolynomial(phi, k.cosc, k.sinq, J);
    RotationPolynomial(phi, -0.5, InverseLeftJacobianCoefficient(phi), J_inverse);
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        const double product = J[3 * r] * J_inverse[c] + J[3 * r + 1] * J_inverse[3 + c] +
                               J[3 * r + 2] * J_inverse[6 + c];
        ASSERT_NEAR(product, r == c ? 1.0 : 0.0, 1e-14) << n;
      }
    }
  }
  const double zero[3] = {0.0, 0.0, 0.0};
  EXPECT_EQ(InverseLeftJacobianCoefficient(zero), 1.0 / 12.0);
}

TEST(Rotation, MatrixToQuaternionUndoesQuaternionToMatrix) {
  std::mt19937_64 random(10);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int n = 0; n < 1000; ++n) {
    // Near 0, at and near half turns about the axes, and anywhere.
    double phi[3] = {uniform(random), uniform(random), uniform(random)};
    if (n % 4 == 0) {
      phi[n / 4 % 3] = M_PI - 1e-9 * n;
      phi[(n / 4 + 1) % 3] = phi[(n / 4 + 2) % 3] = 1e-5 * uniform(random);
    }
    double q[4], R[9], back[4];
    ExpQuaternion(phi, q);
    QuaternionToMatrix(q, R);
    MatrixToQuaternion(R, back);
    const double sign = q[3] < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 4; ++k) {
      ASSERT_NEAR(back[k], sign * q[k], 1e-14) << n;
    }
  }
  const double half_turn[9] = {1, 0, 0, 0, -1, 0, 0, 0, -1};
  double q[4];
  MatrixToQuaternion(half_turn, q);
  EXPECT_EQ(q[0], 1.0);
  EXPECT_EQ(q[3], 0.0);
}

}  // namespace
}  // namespace inceres
