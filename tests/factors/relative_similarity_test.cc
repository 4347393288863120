// Errors of relative similarities: values against the exponential of Sim(3) by its series,
// Jacobians against numeric ones.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "factors/numeric_jacobian.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"

namespace inceres {
namespace {

using Eigen::Matrix4d;
using test::EvaluateFactor;
using test::Random;

constexpr SimilarityErrorConvention kSimilarityConventions[] = {
    SimilarityErrorConvention::kGeodesic, SimilarityErrorConvention::kLogarithm};
const SimilarityManifold kSimilarity;

struct SimilarityState {
  RelativeSimilarityFamily::Measurement measurement;
  test::FactorState state;
  double angle = 0.0;  // of the rotation residual
};

std::vector<double> RandomSimilarity(Random& random, double largest_log) {
  std::vector<double> S(8);
  for (std::size_t k = 0; k < 3; ++k) {
    S[k] = 3.0 * random.Unit();
  }
  test::RandomRotation(random, random.Between(0.0, 3.1), S.data() + 3);
  S[7] = std::exp(random.Between(-largest_log, largest_log));
  return S;
}

// Rotation residuals from exactly 0 to nearly π, ln of the scale's from exactly 0 to 6.
std::vector<SimilarityState> ThousandSimilarityStates() {
  Random random(33);
  const double angles[8] = {0.0, 1e-300, 1e-160, 1e-12, 1e-5, 0.0999, 0.5001, 3.1};
  const double logs[6] = {0.0, 1e-300, 1e-12, 1e-4, 0.3, 6.0};
  std::vector<SimilarityState> states;
  for (int i = 0; i < 1000; ++i) {
    SimilarityState s;
    s.angle = i % 2 == 0 ? angles[(i / 2) % 8] : random.Between(0.0, 3.0);
    const std::vector<double> a = RandomSimilarity(random, 1.0);
    const std::vector<double> m = RandomSimilarity(random, 1.0);
    std::vector<double> E(8), ab(8), b(8);
    for (std::size_t k = 0; k < 3; ++k) {
      E[k] = random.Unit();
    }
    test::RandomRotation(random, s.angle, E.data() + 3);
    E[7] = std::exp(i % 3 == 0 ? logs[(i / 3) % 6] : random.Between(-2.0, 2.0));
    ComposeSimilarities(m.data(), E.data(), ab.data());
    ComposeSimilarities(a.data(), ab.data(), b.data());
    std::copy_n(m.data(), 3, s.measurement.p_m);
    std::copy_n(m.data() + 3, 4, s.measurement.q_m);
    s.measurement.s_m = m[7];
    double G[49], information[49];
    std::generate_n(G, 49, [&random] { return random.Unit(); });
    for (int r = 0; r < 7; ++r) {
      for (int c = 0; c < 7; ++c) {
        information[7 * r + c] = r == c ? 1.0 : 0.0;
        for (int k = 0; k < 7; ++k) {
          information[7 * r + c] += 10.0 * G[7 * k + r] * G[7 * k + c];
        }
      }
    }
    EXPECT_TRUE(SqrtInformation(information, 7, s.measurement.sqrt_information));
    s.state = {{a, b}, {&kSimilarity, &kSimilarity}};
    states.push_back(s);
  }
  return states;
}

RelativeSimilarityFamily::Measurement Unweighted(RelativeSimilarityFamily::Measurement m) {
  for (int k = 0; k < 49; ++k) {
    m.sqrt_information[k] = k % 8 == 0 ? 1.0 : 0.0;
  }
  return m;
}

TEST(RelativeSimilarity, JacobiansAtAThousandStatesInEachConvention) {
  for (const SimilarityErrorConvention convention : kSimilarityConventions) {
    SCOPED_TRACE(ToString(convention));
    int index = 0;
    for (const SimilarityState& s : ThousandSimilarityStates()) {
      RelativeSimilarityFamily family(convention);
      family.Add(s.measurement);
      // Near π the logarithm bends sharply for the differences' step.
      test::ExpectNumericJacobians(family, s.state, s.angle > 2.7 ? 1e-4 : 1e-8, index++);
    }
  }
}

Matrix4d MatrixOf(const double* S) {
  Matrix4d M = Matrix4d::Identity();
  M.topLeftCorner<3, 3>() = S[7] * Eigen::Quaterniond(S[6], S[3], S[4], S[5]).toRotationMatrix();
  M.topRightCorner<3, 1>() = Eigen::Vector3d(S[0], S[1], S[2]);
  return M;
}

// exp of [y; r; λ], scaled and squared.
Matrix4d ExpOfSimilarity(const double* twist) {
  Matrix4d X = Matrix4d::Zero();
  X.topLeftCorner<3, 3>() << twist[6], -twist[5], twist[4], twist[5], twist[6], -twist[3],
      -twist[4], twist[3], twist[6];
  X.topRightCorner<3, 1>() = Eigen::Vector3d(twist[0], twist[1], twist[2]);
  X /= 1024.0;
  Matrix4d sum = Matrix4d::Identity(), term = Matrix4d::Identity();
  for (int n = 1; n < 12; ++n) {
    term = term * X / n;
    sum += term;
  }
  for (int i = 0; i < 10; ++i) {
    sum = sum * sum;
  }
  return sum;
}

TEST(RelativeSimilarity, IsTheLogarithmOfTheErrorAndItsPartsApart) {
  for (const SimilarityState& s : ThousandSimilarityStates()) {
    const RelativeSimilarityFamily::Measurement m = Unweighted(s.measurement);
    double measured[8];
    std::copy_n(m.p_m, 3, measured);
    std::copy_n(m.q_m, 4, measured + 3);
    measured[7] = m.s_m;
    const Matrix4d AB =
        MatrixOf(s.state.parameters[0].data()).inverse() * MatrixOf(s.state.parameters[1].data());
    const Matrix4d E = MatrixOf(measured).inverse() * AB;
    RelativeSimilarityFamily logarithm(SimilarityErrorConvention::kLogarithm), geodesic;
    logarithm.Add(m);
    geodesic.Add(m);
    const std::vector<double> log = EvaluateFactor(logarithm, s.state).residuals;
    EXPECT_LT((ExpOfSimilarity(log.data()) - E).norm(), 1e-10 * (1.0 + E.norm()));
    const std::vector<double> parts = EvaluateFactor(geodesic, s.state).residuals;
    for (std::size_t k = 3; k < 7; ++k) {
      EXPECT_EQ(parts[k], log[k]);
    }
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(parts[static_cast<std::size_t>(k)], AB(k, 3) - m.p_m[k], 1e-12);
    }
  }
}

// With scales of 1 it is what PoseEdgeFamily measures.
TEST(RelativeSimilarity, IsARelativePoseWhereNothingScales) {
  const PoseManifold pose_manifold;
  for (SimilarityState s : ThousandSimilarityStates()) {
    RelativeSimilarityFamily::Measurement m = Unweighted(s.measurement);
    m.s_m = 1.0;
    PoseEdgeFamily::Measurement edge;
    std::copy_n(m.p_m, 3, edge.p_m);
    std::copy_n(m.q_m, 4, edge.q_m);
    for (int k = 0; k < 36; k += 7) {
      edge.sqrt_information[k] = 1.0;
    }
    test::FactorState poses = s.state;
    for (std::size_t k = 0; k < 2; ++k) {
      s.state.parameters[k][7] = 1.0;
      poses.parameters[k].pop_back();
      poses.manifolds[k] = &pose_manifold;
    }
    const PoseErrorConvention same[] = {PoseErrorConvention::kGeodesic,
                                        PoseErrorConvention::kGtsam};
    for (int k = 0; k < 2; ++k) {
      RelativeSimilarityFamily similarity(kSimilarityConventions[k]);
      PoseEdgeFamily relative(same[k]);
      similarity.Add(m);
      relative.Add(edge);
      const std::vector<double> ours = EvaluateFactor(similarity, s.state).residuals;
      const std::vector<double> theirs = EvaluateFactor(relative, poses).residuals;
      for (std::size_t r = 0; r < 6; ++r) {
        EXPECT_NEAR(ours[r], theirs[r], 1e-11);
      }
      EXPECT_EQ(ours[6], 0.0);
    }
  }
}

TEST(RelativeSimilarity, ComposesAndInverts) {
  Random random(5);
  for (int i = 0; i < 100; ++i) {
    const std::vector<double> a = RandomSimilarity(random, 2.0), b = RandomSimilarity(random, 2.0);
    double c[8], inverse[8];
    ComposeSimilarities(a.data(), b.data(), c);
    InvertSimilarity(a.data(), inverse);
    EXPECT_LT((MatrixOf(c) - MatrixOf(a.data()) * MatrixOf(b.data())).norm(), 1e-12);
    EXPECT_LT((MatrixOf(inverse) * MatrixOf(a.data()) - Matrix4d::Identity()).norm(), 1e-12);
  }
}

TEST(RelativeSimilarity, RefusesAScaleThatIsNotPositive) {
  const SimilarityState good = ThousandSimilarityStates()[1];
  for (const double scale : {0.0, -1.0, std::nan("")}) {
    for (int which = 0; which < 3; ++which) {
      SimilarityState s = good;
      (which == 2 ? s.measurement.s_m : s.state.parameters[static_cast<std::size_t>(which)][7]) =
          scale;
      RelativeSimilarityFamily family;
      family.Add(s.measurement);
      const EvaluationFailure failure = EvaluateFactor(family, s.state).failure;
      ASSERT_TRUE(failure.failed());
      EXPECT_STREQ(failure.reason, "a scale is not positive");
    }
  }
  EXPECT_STREQ(ToString(SimilarityErrorConvention::kLogarithm), "logarithm");
}

}  // namespace
}  // namespace inceres
