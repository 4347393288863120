// Errors of relative poses in the conventions of four programs: values against the words of each,
// Jacobians against numeric ones.
#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "factors/pose_states.h"
#include "inceres/factors/relative_pose.h"

namespace inceres {
namespace {

using Eigen::Matrix4d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::EvaluateFactor;
using test::FactorValues;

constexpr PoseErrorConvention kConventions[] = {
    PoseErrorConvention::kGeodesic, PoseErrorConvention::kCeres, PoseErrorConvention::kG2o,
    PoseErrorConvention::kGtsam};

PoseEdgeFamily::Measurement MeasurementOf(const test::RelativePoseState& s) {
  PoseEdgeFamily::Measurement m;
  std::copy_n(s.measurement.p_ab, 3, m.p_m);
  std::copy_n(s.measurement.q_ab, 4, m.q_m);
  std::copy_n(s.measurement.sqrt_information, 36, m.sqrt_information);
  return m;
}

PoseEdgeFamily::Measurement Unweighted(PoseEdgeFamily::Measurement m) {
  for (int k = 0; k < 36; ++k) {
    m.sqrt_information[k] = k % 7 == 0 ? 1.0 : 0.0;
  }
  return m;
}

TEST(PoseEdge, JacobiansAtAThousandStatesInEachConvention) {
  for (const PoseErrorConvention convention : kConventions) {
    SCOPED_TRACE(ToString(convention));
    int index = 0;
    for (const test::RelativePoseState& s : test::ThousandRelativePoseStates()) {
      PoseEdgeFamily family(convention);
      family.Add(MeasurementOf(s));
      // Near π the logarithm bends sharply for the differences' step.
      test::ExpectNumericJacobians(family, s.state, s.angle > 2.7 ? 1e-4 : 1e-8, index++);
    }
  }
}

// A, B and the measured pose as rigid motions, and E = M⁻¹ A⁻¹ B.
struct Motions {
  explicit Motions(const PoseEdgeFamily::Measurement& m, const test::RelativePoseState& s)
      : A(MotionOf(s.state.parameters[0].data(), s.state.parameters[0].data() + 3)),
        B(MotionOf(s.state.parameters[1].data(), s.state.parameters[1].data() + 3)),
        M(MotionOf(m.p_m, m.q_m)),
        E(M.inverse() * A.inverse() * B) {}

  static Eigen::Isometry3d MotionOf(const double* p, const double* q) {
    Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
    motion.linear() = Quaterniond(q[3], q[0], q[1], q[2]).toRotationMatrix();
    motion.translation() = Vector3d(p[0], p[1], p[2]);
    return motion;
  }

  Eigen::Isometry3d A, B, M, E;
};

Vector3d VectorOfUnitQuaternion(const Eigen::Matrix3d& R) {
  const Quaterniond q(R);
  return q.w() < 0.0 ? Vector3d(-q.vec()) : Vector3d(q.vec());
}

// exp of a twist [v; r] by its power series, scaled and squared.
Matrix4d ExpOfTwist(const double* twist) {
  Matrix4d X = Matrix4d::Zero();
  X.topRightCorner<3, 1>() = Vector3d(twist[0], twist[1], twist[2]);
  X.topLeftCorner<3, 3>() << 0.0, -twist[5], twist[4], twist[5], 0.0, -twist[3], -twist[4],
      twist[3], 0.0;
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

TEST(PoseEdge, HasTheValuesOfEachProgram) {
  for (const test::RelativePoseState& s : test::ThousandRelativePoseStates()) {
    const PoseEdgeFamily::Measurement m = Unweighted(MeasurementOf(s));
    const Motions motions(m, s);
    const auto residuals = [&](PoseErrorConvention convention) {
      PoseEdgeFamily family(convention);
      family.Add(m);
      const FactorValues values = EvaluateFactor(family, s.state);
      EXPECT_FALSE(values.failure.failed());
      return values.residuals;
    };
    // g2o: toVectorMQT(M⁻¹ A⁻¹ B).
    const auto g2o = residuals(PoseErrorConvention::kG2o);
    const Vector3d epsilon = VectorOfUnitQuaternion(motions.E.linear());
    // Ceres: t_ab − p_m, and twice the vector of q_m (q_a* q_b)*.
    const auto ceres = residuals(PoseErrorConvention::kCeres);
    const Eigen::Isometry3d AB = motions.A.inverse() * motions.B;
    const Vector3d delta =
        2.0 * VectorOfUnitQuaternion(motions.M.linear() * AB.linear().transpose());
    const auto geodesic = residuals(PoseErrorConvention::kGeodesic);
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      EXPECT_NEAR(g2o[i], motions.E.translation()[k], 1e-13);
      EXPECT_NEAR(g2o[i + 3], epsilon[k], 1e-13);
      EXPECT_NEAR(ceres[i], AB.translation()[k] - m.p_m[k], 1e-13);
      EXPECT_NEAR(ceres[i + 3], delta[k], 1e-13);
      EXPECT_NEAR(geodesic[i], ceres[i], 1e-15);
    }
    EXPECT_NEAR(std::sqrt(geodesic[3] * geodesic[3] + geodesic[4] * geodesic[4] +
                          geodesic[5] * geodesic[5]),
                s.angle, 1e-13);
    // GTSAM: the twist whose exponential is M⁻¹ A⁻¹ B.
    const auto gtsam = residuals(PoseErrorConvention::kGtsam);
    EXPECT_LT((ExpOfTwist(gtsam.data()) - motions.E.matrix()).norm(), 1e-10);
  }
}

TEST(PoseEdge, GeodesicIsWhatRelativePoseMeasures) {
  for (const test::RelativePoseState& s : test::ThousandRelativePoseStates()) {
    PoseEdgeFamily edge;
    edge.Add(Unweighted(MeasurementOf(s)));
    // a is where the edge leads to: seen from b.
    RelativePoseFamily::Measurement inverse;
    std::copy_n(s.measurement.p_ab, 3, inverse.p_ab);
    ConjugateQuaternion(s.measurement.q_ab, inverse.q_ab);
    for (int k = 0; k < 36; k += 7) {
      inverse.sqrt_information[k] = 1.0;
    }
    RelativePoseFamily relative;
    relative.Add(inverse);
    test::FactorState turned = s.state;
    std::swap(turned.parameters[0], turned.parameters[1]);
    const auto ours = EvaluateFactor(edge, s.state).residuals;
    const auto theirs = EvaluateFactor(relative, turned).residuals;
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(ours[k], theirs[3 + k], 1e-14);
      EXPECT_NEAR(ours[3 + k], -theirs[k], s.angle > 3.0 ? 1e-11 : 1e-13);
    }
  }
}

TEST(PoseEdge, FailsOnNonFiniteValues) {
  test::RelativePoseState s = test::ThousandRelativePoseStates().front();
  s.state.parameters[0][1] = std::numeric_limits<double>::infinity();
  for (const PoseErrorConvention convention : kConventions) {
    PoseEdgeFamily family(convention);
    family.Add(MeasurementOf(s));
    EXPECT_STREQ(EvaluateFactor(family, s.state).failure.reason, "a residual is not finite");
  }
}

}  // namespace
}  // namespace inceres
