#pragma once

#include <cmath>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "inceres/factors/imu_preintegrator.h"
#include "inceres/problem/rotation.h"
#include "support/random_values.h"

namespace inceres::test {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Matrix15d = Eigen::Matrix<double, 15, 15, Eigen::RowMajor>;

inline constexpr double kNoBias[3] = {0.0, 0.0, 0.0};

inline Vector3d ToVector(const double* v) {
  return Vector3d(v[0], v[1], v[2]);
}
/// Of x, y, z, w.
inline Quaterniond ToQuaternion(const double* q) {
  return Quaterniond(q[3], q[0], q[1], q[2]);
}
inline Quaterniond Exp(const Vector3d& phi) {
  double q[4];
  ExpQuaternion(phi.data(), q);
  return ToQuaternion(q);
}
inline Vector3d Log(const Quaterniond& q) {
  const double coefficients[4] = {q.x(), q.y(), q.z(), q.w()};
  Vector3d phi;
  LogQuaternion(coefficients, phi.data());
  return phi;
}
inline Matrix3d Cross(const Vector3d& v) {
  Matrix3d M;
  M << 0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0;
  return M;
}

/// (φ, v, p) that takes `a` to `b`, both as ImuDelta counts errors.
inline Eigen::Matrix<double, 9, 1> Difference(const ImuDelta& a, const ImuDelta& b) {
  Eigen::Matrix<double, 9, 1> e;
  e << Log(ToQuaternion(a.q).conjugate() * ToQuaternion(b.q)), ToVector(b.v) - ToVector(a.v),
      ToVector(b.p) - ToVector(a.p);
  return e;
}

inline ImuSample MakeSample(double time, const Vector3d& gyr, const Vector3d& acc) {
  ImuSample sample;
  sample.time = time;
  Eigen::Map<Vector3d>(sample.gyr) = gyr;
  Eigen::Map<Vector3d>(sample.acc) = acc;
  return sample;
}

/// Samples of a lively smooth motion, `count` intervals of `dt` from time 0.
inline std::vector<ImuSample> LivelySamples(Random& random, int count, double dt) {
  const Vector3d a(random.Unit(), random.Unit(), random.Unit());
  const Vector3d b(random.Unit(), random.Unit(), random.Unit());
  std::vector<ImuSample> samples;
  for (int k = 0; k <= count; ++k) {
    const double t = k * dt;
    const Vector3d gyr = a * std::sin(3.0 * t + b[0]) + 0.5 * b;
    const Vector3d acc = 3.0 * b * std::cos(2.0 * t + a[1]) + Vector3d(0.0, 0.0, 9.81) + a;
    samples.push_back(MakeSample(t, gyr, acc));
  }
  return samples;
}

inline ImuPreintegrator Integrated(const ImuOptions& options, const std::vector<ImuSample>& samples,
                                   const double* gyr_bias = kNoBias,
                                   const double* acc_bias = kNoBias) {
  ImuPreintegrator imu(options);
  const Status status = imu.Integrate(samples, gyr_bias, acc_bias);
  EXPECT_TRUE(status.ok()) << status.message;
  return imu;
}

/// Any conventions: the bits of `number` choose.
inline ImuConventions NumberedConventions(int number) {
  const ImuConventions bases[4] = {ImuConventions(), ImuConventions::Vins(),
                                   ImuConventions::Okvis(), ImuConventions::Xrslam()};
  ImuConventions c = bases[number & 3];
  c.perturbation = static_cast<ImuConventions::Perturbation>(number >> 2 & 1);
  c.rotation_residual = static_cast<ImuConventions::RotationResidual>(number >> 3 & 1);
  c.sign = static_cast<ImuConventions::Sign>(number >> 4 & 1);
  c.bias_order = static_cast<ImuConventions::BiasOrder>(number >> 5 & 1);
  c.integration = static_cast<ImuConventions::Integration>(number >> 6 & 1);
  c.noise = static_cast<ImuConventions::Noise>(number >> 7 & 1);
  c.bias_walks_while_integrating = (number >> 8 & 1) != 0;
  return c;
}
inline constexpr int kNumConventions = 512;

}  // namespace inceres::test
