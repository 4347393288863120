// Preintegration against closed-form motions, numeric derivatives and a covariance of numeric
// steps.
#include "inceres/factors/imu_preintegrator.h"

#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "factors/imu_support.h"

namespace inceres {
namespace {

using test::Exp;
using test::Integrated;
using test::MakeSample;
using test::Matrix3d;
using test::Quaterniond;
using test::ToQuaternion;
using test::ToVector;
using test::Vector3d;
using Integration = ImuConventions::Integration;

constexpr double kDuration = 0.8;

ImuOptions With(Integration integration) {
  ImuOptions options;
  options.conventions.integration = integration;
  return options;
}

// Errors of the integrated rotation, velocity and position.
struct Errors {
  double rotation, velocity, position;
};

Errors ErrorsOf(const ImuPreintegrator& imu, const Vector3d& turn, const Vector3d& v,
                const Vector3d& p) {
  return {test::Log(Exp(turn).conjugate() * ToQuaternion(imu.delta().q)).norm(),
          (ToVector(imu.delta().v) - v).norm(), (ToVector(imu.delta().p) - p).norm()};
}

// Turns at a constant rate ω while the force in the world, which is the first frame, is f + ct²:
// the one felt turns backwards.
Errors SteadyInTheWorld(Integration integration, int count, const Vector3d& c) {
  const Vector3d omega(0.7, -1.1, 0.4);
  const Vector3d force(1.0, -2.0, 9.0);
  std::vector<ImuSample> samples;
  for (int k = 0; k <= count; ++k) {
    const double t = kDuration * k / count;
    samples.push_back(MakeSample(t, omega, Exp(omega * t).conjugate() * (force + c * t * t)));
  }
  constexpr double T = kDuration;
  return ErrorsOf(Integrated(With(integration), samples), omega * T,
                  force * T + c * T * T * T / 3.0, 0.5 * force * T * T + c * T * T * T * T / 12.0);
}

Errors GrowingInTheWorld(Integration integration, int count) {
  return SteadyInTheWorld(integration, count, Vector3d(3.0, 1.0, -2.0));
}

// Rate and force constant in the body: Δv = ∫ Exp(ωt) f dt, Δp = ∫ Δv dt.
Errors SteadyInTheBody(Integration integration, int count) {
  const Vector3d omega(-0.5, 0.9, 1.3);
  const Vector3d force(0.5, 1.5, 9.0);
  std::vector<ImuSample> samples;
  for (int k = 0; k <= count; ++k) {
    samples.push_back(MakeSample(kDuration * k / count, omega, force));
  }
  const Vector3d turn = omega * kDuration;
  const double a = turn.norm();
  const Matrix3d W = test::Cross(turn);
  const Matrix3d I = Matrix3d::Identity();
  const Matrix3d once =
      I + (1.0 - std::cos(a)) / (a * a) * W + (a - std::sin(a)) / (a * a * a) * W * W;
  const Matrix3d twice = 0.5 * I + (a - std::sin(a)) / (a * a * a) * W +
                         (0.5 * a * a + std::cos(a) - 1.0) / (a * a * a * a) * W * W;
  return ErrorsOf(Integrated(With(integration), samples), turn, once * force * kDuration,
                  twice * force * kDuration * kDuration);
}

TEST(ImuPreintegrator, ConvergesToClosedFormMotionsAtItsOrder) {
  for (const auto& motion : {GrowingInTheWorld, SteadyInTheBody}) {
    for (const auto& [integration, order] :
         {std::pair(Integration::kEuler, 1), std::pair(Integration::kMidpoint, 2)}) {
      Errors coarse = motion(integration, 50);
      EXPECT_GT(coarse.velocity, 1e-6) << "too good to tell the order";
      for (const int count : {100, 200, 400}) {
        const Errors fine = motion(integration, count);
        EXPECT_LT(fine.rotation, 1e-13) << "exact at a constant rate";
        EXPECT_NEAR(std::log2(coarse.velocity / fine.velocity), order, 0.1);
        EXPECT_NEAR(std::log2(coarse.position / fine.position), order, 0.1);
        coarse = fine;
      }
    }
  }
}

TEST(ImuPreintegrator, IsExactAtAConstantRateAndAcceleration) {
  for (const Integration integration : {Integration::kEuler, Integration::kMidpoint}) {
    for (const int count : {1, 2, 10}) {
      const Errors errors = SteadyInTheWorld(integration, count, Vector3d::Zero());
      EXPECT_LT(errors.rotation + errors.velocity + errors.position, 1e-14);
    }
  }
}

TEST(ImuPreintegrator, IsExactWithoutRotation) {
  const Vector3d force(1.0, -2.0, 9.0);
  const double bias[3] = {0.1, 0.2, -0.3};
  std::vector<ImuSample> samples;
  for (const double t : {2.0, 2.1, 2.15, 2.4, 3.0}) {
    samples.push_back(MakeSample(t, ToVector(bias), force + ToVector(bias)));
  }
  for (const Integration integration : {Integration::kEuler, Integration::kMidpoint}) {
    const ImuPreintegrator imu = Integrated(With(integration), samples, bias, bias);
    const Errors errors = ErrorsOf(imu, Vector3d::Zero(), force, 0.5 * force);
    EXPECT_LT(errors.rotation + errors.velocity + errors.position, 1e-13);
    EXPECT_NEAR(imu.delta().dt, 1.0, 1e-15);
  }
}

TEST(ImuPreintegrator, AppendingIsIntegratingAll) {
  test::Random random(3);
  const std::vector<ImuSample> all = test::LivelySamples(random, 20, 0.01);
  const ImuPreintegrator whole = Integrated({}, all);
  ImuPreintegrator parts = Integrated({}, {all.begin(), all.begin() + 7});
  ASSERT_TRUE(parts.Append({all.begin() + 7, all.begin() + 8}).ok());
  ASSERT_TRUE(parts.Append({}).ok());
  ASSERT_TRUE(parts.Append({all.begin() + 8, all.end()}).ok());
  EXPECT_EQ(test::Difference(whole.delta(), parts.delta()).norm(), 0.0);
  EXPECT_TRUE(std::equal(whole.delta().covariance, whole.delta().covariance + 225,
                         parts.delta().covariance));
  EXPECT_TRUE(std::equal(whole.delta().bias_jacobian, whole.delta().bias_jacobian + 54,
                         parts.delta().bias_jacobian));
  EXPECT_EQ(whole.samples().size(), parts.samples().size());
}

TEST(ImuPreintegrator, BiasJacobiansAreNumericOnes) {
  test::Random random(4);
  for (int number = 0; number < 20; ++number) {
    const ImuOptions options = With(number % 2 == 0 ? Integration::kEuler : Integration::kMidpoint);
    const std::vector<ImuSample> samples = test::LivelySamples(random, 2 + 3 * number, 0.01);
    double biases[6];
    for (double& b : biases) {
      b = 0.1 * random.Unit();
    }
    ImuPreintegrator imu = Integrated(options, samples, biases, biases + 3);
    const ImuDelta center = imu.delta();
    for (int c = 0; c < 6; ++c) {
      constexpr double kStep = 1e-4;
      Eigen::Matrix<double, 9, 1> at[2];
      for (const int side : {0, 1}) {
        double moved[6];
        std::copy_n(biases, 6, moved);
        moved[c] += side == 0 ? -kStep : kStep;
        ASSERT_TRUE(imu.Reintegrate(moved, moved + 3).ok());
        at[side] = test::Difference(center, imu.delta());
      }
      const Eigen::Matrix<double, 9, 1> numeric = (at[1] - at[0]) / (2.0 * kStep);
      for (int r = 0; r < 9; ++r) {
        EXPECT_NEAR(center.bias_jacobian[6 * r + c], numeric[r], 1e-8)
            << "row " << r << ", column " << c;
      }
    }
  }
}

// One step of (ΔR, Δv, Δp, b_g, b_a), and its derivatives by differences: an oracle for the
// covariance that shares no formula.
struct Motion {
  Quaterniond q = Quaterniond::Identity();
  Vector3d v = Vector3d::Zero(), p = Vector3d::Zero(), bg = Vector3d::Zero(), ba = Vector3d::Zero();
};
using Vector15d = Eigen::Matrix<double, 15, 1>;

Motion Moved(const Motion& m, const Vector15d& e) {
  Motion moved = m;
  moved.q = m.q * Exp(e.segment<3>(0));
  moved.v += e.segment<3>(3);
  moved.p += e.segment<3>(6);
  moved.bg += e.segment<3>(9);
  moved.ba += e.segment<3>(12);
  return moved;
}

Vector15d Minus(const Motion& b, const Motion& a) {
  Vector15d e;
  e << test::Log(a.q.conjugate() * b.q), b.v - a.v, b.p - a.p, b.bg - a.bg, b.ba - a.ba;
  return e;
}

// `noise`: rate and force at the one end, then at the other.
using Noise12 = Eigen::Matrix<double, 12, 1>;
Motion Step(bool midpoint, const ImuSample& from, const ImuSample& to, const Motion& m,
            const Noise12& noise) {
  const double dt = to.time - from.time;
  const Vector3d w_0 = ToVector(from.gyr) + noise.segment<3>(0) - m.bg,
                 w_1 = ToVector(to.gyr) + noise.segment<3>(6) - m.bg;
  const Vector3d f_0 = ToVector(from.acc) + noise.segment<3>(3) - m.ba,
                 f_1 = ToVector(to.acc) + noise.segment<3>(9) - m.ba;
  Motion next = m;
  next.q = m.q * Exp(dt * (midpoint ? Vector3d(0.5 * (w_0 + w_1)) : w_0));
  const Vector3d a = midpoint ? Vector3d(0.5 * (m.q * f_0 + next.q * f_1)) : m.q * f_0;
  next.v = m.v + dt * a;
  next.p = m.p + dt * m.v + 0.5 * dt * dt * a;
  return next;
}

template <int columns, typename Function>
Eigen::Matrix<double, 15, columns> Differentiate(const Function& f) {
  constexpr double kStep = 1e-5;
  Eigen::Matrix<double, 15, columns> J;
  for (int c = 0; c < columns; ++c) {
    Eigen::Matrix<double, columns, 1> step = Eigen::Matrix<double, columns, 1>::Zero();
    step[c] = kStep;
    J.col(c) = Minus(f(step), f(-step)) / (2.0 * kStep);
  }
  return J;
}

test::Matrix15d NumericCovariance(const ImuOptions& options,
                                  const std::vector<ImuSample>& samples) {
  const ImuConventions& conventions = options.conventions;
  const bool midpoint = conventions.integration == Integration::kMidpoint;
  const bool continuous = conventions.noise == ImuConventions::Noise::kContinuous;
  test::Matrix15d covariance = test::Matrix15d::Zero();
  Motion motion;
  for (std::size_t k = 1; k < samples.size(); ++k) {
    const ImuSample& from = samples[k - 1];
    const ImuSample& to = samples[k];
    const double dt = to.time - from.time;
    Eigen::Matrix<double, 15, 15> F = Differentiate<15>([&](const Vector15d& e) {
      return Step(midpoint, from, to, Moved(motion, e), Noise12::Zero());
    });
    if (!conventions.bias_walks_while_integrating) {
      F.topRightCorner<9, 6>().setZero();
    }
    const auto V =
        Differentiate<12>([&](const Noise12& n) { return Step(midpoint, from, to, motion, n); });
    // With a density both ends of an interval share one draw.
    Eigen::Matrix<double, 12, 12> Q = Eigen::Matrix<double, 12, 12>::Zero();
    for (int r = 0; r < 12; ++r) {
      const double sigma = r % 6 < 3 ? options.noise.gyr : options.noise.acc;
      const double variance = continuous ? sigma * sigma / dt : sigma * sigma;
      Q(r, r) = variance;
      if (continuous) {
        Q(r, (r + 6) % 12) = variance;
      }
    }
    covariance = (F * covariance * F.transpose() + V * Q * V.transpose()).eval();
    for (int r = 0; r < 3; ++r) {
      const double share = continuous ? dt : dt * dt;
      covariance(6 + r, 6 + r) +=
          continuous ? options.noise.acc * options.noise.acc * dt * dt * dt / 12.0 : 0.0;
      covariance(9 + r, 9 + r) += options.noise.gyr_bias_walk * options.noise.gyr_bias_walk * share;
      covariance(12 + r, 12 + r) +=
          options.noise.acc_bias_walk * options.noise.acc_bias_walk * share;
    }
    motion = Step(midpoint, from, to, motion, Noise12::Zero());
  }
  return covariance;
}

TEST(ImuPreintegrator, CovarianceIsThatOfNumericSteps) {
  test::Random random(5);
  for (int number = 0; number < test::kNumConventions; number += 64) {
    ImuOptions options;
    options.conventions = test::NumberedConventions(number + 1);
    options.noise = {0.02, 0.05, 0.03, 0.04};
    const std::vector<ImuSample> samples = test::LivelySamples(random, 12, 0.02);
    const ImuPreintegrator imu = Integrated(options, samples);
    const test::Matrix15d expected = NumericCovariance(options, samples);
    for (int r = 0; r < 15; ++r) {
      for (int c = 0; c < 15; ++c) {
        EXPECT_NEAR(imu.delta().covariance[15 * r + c], expected(r, c),
                    1e-8 * std::sqrt(expected(r, r) * expected(c, c)))
            << "conventions " << number << ", entry " << r << ", " << c;
      }
    }
  }
}

TEST(ImuPreintegrator, SqrtInformationIsTheCholeskyFactorOfTheInverseCovariance) {
  test::Random random(6);
  for (int number = 0; number < test::kNumConventions; ++number) {
    ImuOptions options;
    options.conventions = test::NumberedConventions(number);
    const ImuPreintegrator imu =
        Integrated(options, test::LivelySamples(random, 2 + number % 40, 0.005));
    test::Matrix15d U, covariance;
    ASSERT_TRUE(imu.SqrtInformation(U.data()).ok());
    imu.ResidualCovariance(covariance.data());
    const Eigen::Matrix<double, 15, 15> whitened = U * covariance * U.transpose();
    EXPECT_TRUE(whitened.isIdentity(1e-10)) << "conventions " << number;
    EXPECT_TRUE(U.isUpperTriangular(0.0));
    EXPECT_GT(U.diagonal().minCoeff(), 0.0);
  }
}

TEST(ImuPreintegrator, FirstOrderCorrectionErrsQuadratically) {
  test::Random random(7);
  const std::vector<ImuSample> samples = test::LivelySamples(random, 40, 0.01);
  const ImuPreintegrator imu = Integrated({}, samples);
  const Vector3d direction(0.3, -0.5, 0.2);
  double previous = 0.0;
  for (const double scale : {0.2, 0.1, 0.05}) {
    const Vector3d change = scale * direction;
    const ImuPreintegrator exact = Integrated({}, samples, change.data(), change.data());
    Eigen::Matrix<double, 6, 1> both;
    both << change, change;
    const Eigen::Map<const Eigen::Matrix<double, 9, 6, Eigen::RowMajor>> J(
        imu.delta().bias_jacobian);
    const Eigen::Matrix<double, 9, 1> step = J * both;
    const double error = (test::Difference(imu.delta(), exact.delta()) - step).norm();
    EXPECT_GT(error, 1e-8);
    if (previous > 0.0) {
      EXPECT_NEAR(previous / error, 4.0, 0.3);
    }
    previous = error;
  }
}

TEST(ImuPreintegrator, AsksForReintegrationPastItsLimits) {
  test::Random random(8);
  ImuOptions options;
  options.max_rotation_change = 1e-3;
  options.max_speed_change = 1e-2;
  // half a second
  ImuPreintegrator imu = Integrated(options, test::LivelySamples(random, 50, 0.01));
  const double small[3] = {0.0, 0.00199, 0.0}, large[3] = {0.0, 0.00201, 0.0};
  const double slow[3] = {0.0199, 0.0, 0.0}, fast[3] = {0.0201, 0.0, 0.0};
  EXPECT_FALSE(imu.NeedsReintegration(small, slow));
  EXPECT_TRUE(imu.NeedsReintegration(large, slow));
  EXPECT_TRUE(imu.NeedsReintegration(small, fast));
  ASSERT_TRUE(imu.Reintegrate(large, fast).ok());
  EXPECT_FALSE(imu.NeedsReintegration(large, fast));
  EXPECT_TRUE(imu.NeedsReintegration(test::kNoBias, test::kNoBias));
}

// A call that must fail: with this word in its message, and the object as before.
template <typename Call>
void ExpectRefused(ImuPreintegrator imu, const char* word, const Call& call) {
  const ImuPreintegrator before = imu;
  const Status status = call(&imu);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find(word), std::string::npos) << status.message;
  EXPECT_EQ(imu.samples().size(), before.samples().size());
  EXPECT_EQ(test::Difference(before.delta(), imu.delta()).norm(), 0.0);
  EXPECT_EQ(imu.delta().dt, before.delta().dt);
}

TEST(ImuPreintegrator, RefusesBadInputAndStaysAsItWas) {
  test::Random random(9);
  const std::vector<ImuSample> good = test::LivelySamples(random, 5, 0.01);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double bad_bias[3] = {0.0, nan, 0.0};
  const ImuPreintegrator imu = Integrated({}, good);
  const auto integrate = [](std::vector<ImuSample> samples) {
    return [samples](ImuPreintegrator* p) {
      return p->Integrate(samples, test::kNoBias, test::kNoBias);
    };
  };
  ExpectRefused(imu, "two samples", integrate({}));
  ExpectRefused(imu, "got 1", integrate({good[0]}));
  std::vector<ImuSample> samples = good;
  samples[3].acc[1] = nan;
  ExpectRefused(imu, "IMU sample 3 of 6", integrate(samples));
  samples = good;
  samples[2].gyr[0] = std::numeric_limits<double>::infinity();
  ExpectRefused(imu, "IMU sample 2 of 6", integrate(samples));
  samples = good;
  samples[4].time = samples[3].time;
  ExpectRefused(imu, "IMU sample 4 of 6 has time 0.03", integrate(samples));
  ExpectRefused(imu, "gyroscope bias",
                [&](ImuPreintegrator* p) { return p->Integrate(good, bad_bias, test::kNoBias); });
  ExpectRefused(imu, "accelerometer bias",
                [&](ImuPreintegrator* p) { return p->Reintegrate(test::kNoBias, bad_bias); });
  ExpectRefused(imu, "not after the one before it, 0.05",
                [&](ImuPreintegrator* p) { return p->Append({good[2]}); });
  const ImuPreintegrator blank;
  ExpectRefused(blank, "nothing was integrated",
                [&](ImuPreintegrator* p) { return p->Append(good); });
  ExpectRefused(blank, "nothing was integrated",
                [&](ImuPreintegrator* p) { return p->Reintegrate(test::kNoBias, test::kNoBias); });
  samples = good;
  samples[1].acc[0] = 1e308;
  samples[1].time = 1e3;
  samples.resize(3);
  samples[2].time = 1e6;
  ImuPreintegrator overflowing = imu;
  EXPECT_EQ(overflowing.Integrate(samples, test::kNoBias, test::kNoBias).code,
            StatusCode::kEvaluationFailed);
  EXPECT_EQ(overflowing.delta().dt, imu.delta().dt);
}

TEST(ImuOptions, RefusesWhatMakesNoSense) {
  const auto expect = [](const char* word, const ImuOptions& options) {
    test::Random random(10);
    ImuPreintegrator imu(options);
    const Status status =
        imu.Integrate(test::LivelySamples(random, 3, 0.01), test::kNoBias, test::kNoBias);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find(word), std::string::npos) << status.message;
  };
  const auto with = [](auto change) {
    ImuOptions options;
    change(&options);
    return options;
  };
  expect("ImuNoise::gyr ", with([](ImuOptions* o) { o->noise.gyr = 0.0; }));
  expect("ImuNoise::acc ", with([](ImuOptions* o) { o->noise.acc = -1.0; }));
  expect("gyr_bias_walk", with([](ImuOptions* o) { o->noise.gyr_bias_walk = NAN; }));
  expect("acc_bias_walk", with([](ImuOptions* o) { o->noise.acc_bias_walk = INFINITY; }));
  expect("max_rotation_change", with([](ImuOptions* o) { o->max_rotation_change = -1.0; }));
  expect("max_speed_change", with([](ImuOptions* o) { o->max_speed_change = NAN; }));
  expect("gravity", with([](ImuOptions* o) { o->conventions.gravity[1] = NAN; }));
  expect("residual_order",
         with([](ImuOptions* o) { o->conventions.residual_order[0] = ImuPart::kAccBias; }));
}

TEST(ImuPreintegrator, OneIntervalHasInformationWithADensityOnly) {
  test::Random random(11);
  const std::vector<ImuSample> samples = test::LivelySamples(random, 1, 0.005);
  double U[225];
  EXPECT_TRUE(Integrated({}, samples).SqrtInformation(U).ok());
  for (const Integration integration : {Integration::kEuler, Integration::kMidpoint}) {
    ImuOptions options = With(integration);
    options.conventions.noise = ImuConventions::Noise::kPerSample;
    const Status status = Integrated(options, samples).SqrtInformation(U);
    EXPECT_EQ(status.code, StatusCode::kSingular);
    EXPECT_NE(status.message.find("2 samples"), std::string::npos) << status.message;
  }
  EXPECT_EQ(ImuPreintegrator().SqrtInformation(U).code, StatusCode::kSingular);
}

TEST(InterpolateImuSamples, CutsAtTheBorders) {
  std::vector<ImuSample> samples;
  for (int k = 0; k <= 4; ++k) {
    samples.push_back(MakeSample(k, Vector3d(k, 0.0, 1.0), Vector3d(0.0, 10.0 * k, 0.0)));
  }
  std::vector<ImuSample> cut;
  ASSERT_TRUE(InterpolateImuSamples(samples, 0.25, 3.0, &cut).ok());
  ASSERT_EQ(cut.size(), 4U);
  EXPECT_EQ(cut[0].time, 0.25);
  EXPECT_EQ(cut[0].gyr[0], 0.25);
  EXPECT_EQ(cut[0].gyr[2], 1.0);
  EXPECT_EQ(cut[0].acc[1], 2.5);
  EXPECT_EQ(cut[1].time, 1.0);
  EXPECT_EQ(cut[3].time, 3.0);
  EXPECT_EQ(cut[3].acc[1], 30.0);
  ASSERT_TRUE(InterpolateImuSamples(samples, 1.5, 1.75, &cut).ok());
  EXPECT_EQ(cut.size(), 2U);
  ASSERT_TRUE(InterpolateImuSamples(samples, 0.0, 4.0, &cut).ok());
  EXPECT_EQ(cut.size(), 5U);
  const auto expect_refused = [&](const char* word, const std::vector<ImuSample>& from,
                                  double begin, double end) {
    const Status status = InterpolateImuSamples(from, begin, end, &cut);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find(word), std::string::npos) << status.message;
    EXPECT_EQ(cut.size(), 5U);
  };
  expect_refused("begin at 0.0", samples, -1.0, 2.0);
  expect_refused("end at 4.0", samples, 1.0, 4.5);
  expect_refused("there are none", {}, 1.0, 2.0);
  expect_refused("is empty", samples, 2.0, 2.0);
  expect_refused("is empty", samples, NAN, 2.0);
  samples[2].time = 0.5;
  expect_refused("IMU sample 2", samples, 1.0, 2.0);
}

}  // namespace
}  // namespace inceres
