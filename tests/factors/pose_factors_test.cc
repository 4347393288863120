// The factors between poses: Jacobians against numeric ones, failures, whitening.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "factors/pose_states.h"

namespace inceres {
namespace {

using test::EvaluateFactor;
using test::FactorState;
using test::FactorValues;

TEST(InverseDepthReprojection, JacobiansAtAThousandStates) {
  int index = 0;
  for (const test::ReprojectionState& s : test::ThousandReprojectionStates()) {
    InverseDepthReprojectionFamily family;
    family.Add(s.measurement);
    test::ExpectNumericJacobians(family, s.state, 1e-8, index++);
  }
}

TEST(InverseDepthReprojection, AFeatureInFrontOfBothCameras) {
  // a at the origin sees the point (0.4, 0, 2); b stands 1 m to the right, turned by 90° to the
  // left (about −y): it looks along −x.
  InverseDepthReprojectionFamily family;
  family.Add({{0.2, 0.0}, {0.0, 0.5}, {2.0, 3.0, 4.0}});
  const double half = std::sqrt(0.5);
  const FactorState state{{{0, 0, 0, 0, 0, 0, 1}, {1, 0, 2.2, 0, -half, 0, half}, {0.5}},
                          {&test::kPoseManifold, &test::kPoseManifold, nullptr}};
  const FactorValues values = EvaluateFactor(family, state);
  ASSERT_FALSE(values.failure.failed());
  // In b: depth 0.6, offset to the left of b's axis (its right is +z): −0.2. Errors (−1/3, −0.5), U
  // = [2 3; 0 4].
  EXPECT_NEAR(values.residuals[0], 2.0 * (-1.0 / 3.0) + 3.0 * -0.5, 1e-14);
  EXPECT_NEAR(values.residuals[1], 4.0 * -0.5, 1e-14);
}

TEST(InverseDepthReprojection, FailsInTheCamerasPlaneAndOnNonFiniteValues) {
  InverseDepthReprojectionFamily family;
  family.Add({});
  FactorState state{{{0, 0, 0, 0, 0, 0, 1}, {0, 0, 2, 0, 0, 0, 1}, {0.5}},
                    {&test::kPoseManifold, &test::kPoseManifold, nullptr}};
  EXPECT_STREQ(EvaluateFactor(family, state).failure.reason,
               "the feature lies in the observing camera's plane (depth 0)");
  state.parameters[1][0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_STREQ(EvaluateFactor(family, state).failure.reason, "a residual is not finite");
  EXPECT_EQ(EvaluateFactor(family, state).failure.factor, 0);
  // A residual of exactly 0 whose derivative overflows: a huge weight and a huge baseline.
  InverseDepthReprojectionFamily heavy;
  heavy.Add({{0.0, 0.0}, {0.0, 0.0}, {1e200, 0.0, 1.0}});
  state.parameters = {{0, 0, 0, 0, 0, 0, 1}, {1e200, 0, 0, 0, 0, 0, 1}, {0.0}};
  EXPECT_STREQ(EvaluateFactor(heavy, state).failure.reason, "a Jacobian entry is not finite");
}

TEST(RelativePose, JacobiansAtAThousandStates) {
  int index = 0;
  for (const test::RelativePoseState& s : test::ThousandRelativePoseStates()) {
    RelativePoseFamily family;
    family.Add(s.measurement);
    // Near π the logarithm bends sharply for the differences' step.
    test::ExpectNumericJacobians(family, s.state, s.angle > 2.9 ? 1e-4 : 1e-8, index++);
  }
}

TEST(RelativePose, ResidualIsTheErrorPutIn) {
  for (const test::RelativePoseState& s : test::ThousandRelativePoseStates()) {
    RelativePoseFamily family;
    RelativePoseFamily::Measurement plain = s.measurement;
    for (int k = 0; k < 36; ++k) {
      plain.sqrt_information[k] = k % 7 == 0 ? 1.0 : 0.0;
    }
    family.Add(plain);
    const FactorValues values = EvaluateFactor(family, s.state);
    const double* r = values.residuals.data();
    EXPECT_NEAR(std::sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]), s.angle, 1e-14);
    // R_b (r_p + p_ab) + p_b = p_a
    double R_b[9], world[3];
    const double t[3] = {r[3] + plain.p_ab[0], r[4] + plain.p_ab[1], r[5] + plain.p_ab[2]};
    QuaternionToMatrix(s.state.parameters[1].data() + 3, R_b);
    MultiplyMatrixVector(R_b, t, world);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(world[k] + s.state.parameters[1][k], s.state.parameters[0][k], 1e-13);
    }
  }
}

TEST(RelativePose, FailsOnNonFiniteValues) {
  RelativePoseFamily family;
  RelativePoseFamily::Measurement measurement;
  measurement.sqrt_information[35] = 1.0;
  family.Add(measurement);
  FactorState state{{{0, 0, 0, 0, 0, 0, 1}, {0, 0, 2, 0, 0, 0, 1}},
                    {&test::kPoseManifold, &test::kPoseManifold}};
  EXPECT_FALSE(EvaluateFactor(family, state).failure.failed());
  state.parameters[0][2] = std::numeric_limits<double>::infinity();
  EXPECT_STREQ(EvaluateFactor(family, state).failure.reason, "a residual is not finite");
}

TEST(SqrtInformation, IsACholeskyFactor) {
  test::Random random(8);
  for (int n = 1; n <= 6; ++n) {
    std::vector<double> G = random.Vector(static_cast<std::size_t>(n * n));
    std::vector<double> W(G.size()), U(G.size());
    const auto at = [n](const std::vector<double>& M, int r, int c) {
      return M[static_cast<std::size_t>(r * n + c)];
    };
    for (int k = 0; k < n * n; ++k) {
      W[static_cast<std::size_t>(k)] = k % (n + 1) == 0 ? 0.1 : 0.0;
      for (int j = 0; j < n; ++j) {
        W[static_cast<std::size_t>(k)] += at(G, j, k / n) * at(G, j, k % n);
      }
    }
    ASSERT_TRUE(SqrtInformation(W.data(), n, U.data()));
    for (int r = 0; r < n; ++r) {
      for (int c = 0; c < n; ++c) {
        double sum = 0.0;
        for (int k = 0; k < n; ++k) {
          sum += at(U, k, r) * at(U, k, c);
        }
        EXPECT_NEAR(sum, at(W, r, c), 1e-14);
        EXPECT_TRUE(c >= r || at(U, r, c) == 0.0);
      }
    }
  }
}

TEST(SqrtInformation, RefusesWhatHasNoFactor) {
  double U[4];
  for (const std::vector<double>& W : {std::vector<double>{1, 2, 2, 1},
                                       {0, 0, 0, 1},
                                       {-1, 0, 0, 1},
                                       {1, 0, 0, NAN},
                                       {1, INFINITY, 0, 1}}) {
    EXPECT_FALSE(SqrtInformation(W.data(), 2, U));
  }
}

}  // namespace
}  // namespace inceres
