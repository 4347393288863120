// Lesson 8, an IMU: gyroscope and accelerometer between poses that are measured twice a second. The
// biases come out, and with them the IMU alone goes on for two seconds.
//
//     08_imu
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <limits>
#include <memory>
#include <vector>

#include "examples/noise.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"

namespace {

constexpr double kRate = 200.0, kFrameSeconds = 0.5, kTurn = 0.5;  // Hz, s, rad/s
constexpr int kNumFrames = 24;
constexpr double kGyrBias[3] = {0.02, -0.015, 0.01}, kAccBias[3] = {0.1, -0.05, 0.08};

Noise noise(8);

// A circle of 3 m, driven at 1.5 m/s with the x axis ahead: the true pose at a time.
void TruePose(double t, double pose[7]) {
  const double angle = kTurn * t, turn[3] = {0.0, 0.0, angle};
  pose[0] = 3.0 * std::sin(angle);
  pose[1] = 3.0 - 3.0 * std::cos(angle);
  pose[2] = 0.0;
  inceres::ExpQuaternion(turn, pose + 3);
}

// What the IMU then measures, with biases and noise: it turns, and is drawn to the center.
std::vector<inceres::ImuSample> Samples(double begin, double seconds, const inceres::ImuNoise& n) {
  std::vector<inceres::ImuSample> samples;
  for (int i = 0; i <= static_cast<int>(seconds * kRate); ++i) {
    inceres::ImuSample sample = {begin + i / kRate, {0, 0, kTurn}, {0, 3 * kTurn * kTurn, 9.81}};
    for (int k = 0; k < 3; ++k) {
      sample.gyr[k] += kGyrBias[k] + noise.Normal(n.gyr * std::sqrt(kRate));
      sample.acc[k] += kAccBias[k] + noise.Normal(n.acc * std::sqrt(kRate));
    }
    samples.push_back(sample);
  }
  return samples;
}

// Where the IMU alone puts a state two seconds later, meters from the truth.
double ErrorAhead(const double* pose, const double* speed_bias, const inceres::ImuOptions& options,
                  double time) {
  inceres::ImuPreintegrator imu(options);
  double there[7], speed_bias_there[9], truth[7];
  if (!imu.Integrate(Samples(time, 2.0, options.noise), speed_bias + 3, speed_bias + 6).ok() ||
      !inceres::PropagateImu(imu, pose, speed_bias, nullptr, there, speed_bias_there, nullptr)
           .ok()) {
    return std::numeric_limits<double>::infinity();
  }
  TruePose(time + 2.0, truth);
  return std::hypot(there[0] - truth[0], there[1] - truth[1], there[2] - truth[2]);
}

}  // namespace

int main() {
  // [quoted in docs/lessons/08_imu.md]
  inceres::ImuOptions options;  // conventions: velocity, gyroscope's bias, accelerometer's bias
  options.noise = {1e-3, 1e-2, 1e-5, 1e-4};  // gyr, acc, the walks of their biases
  inceres::FactorGraph graph;
  const auto imu_factors = graph.AddFamily(std::make_shared<inceres::ImuFactorFamily>());
  const auto fixes = graph.AddFamily(std::make_shared<inceres::PosePriorFamily>());
  const auto manifold = std::make_shared<inceres::PoseManifold>();
  inceres::VariableId pose = -1, speed_bias = -1;
  for (int i = 0; i < kNumFrames; ++i) {
    inceres::PosePriorFamily::Measurement fix;
    TruePose(i * kFrameSeconds, fix.pose);
    for (int k = 0; k < 6; ++k) {
      fix.pose[k % 3] += k < 3 ? noise.Normal(0.01) : 0.0;     // a centimeter
      fix.sqrt_information[7 * k] = k < 3 ? 1.0 / 0.01 : 1e3;  // and a milliradian
    }
    const double start[9] = {1.5, 0.0, 0.0};  // speed ahead, and no biases
    const inceres::VariableId last_pose = pose, last_speed_bias = speed_bias;
    pose = graph.AddVariable(fix.pose, 7, inceres::Role::kFrame, manifold);
    speed_bias = graph.AddVariable(start, 9, inceres::Role::kFrame);
    graph.AddFactor(fixes, fix, {pose});
    if (i > 0) {
      inceres::ImuPreintegrator imu(options);
      const auto samples = Samples((i - 1) * kFrameSeconds, kFrameSeconds, options.noise);
      if (const auto status = imu.Integrate(samples, start + 3, start + 6); !status.ok()) {
        std::cerr << status.message << '\n';  // which sample, and what is wrong with it
        return 1;
      }
      graph.AddFactor(imu_factors, imu, {last_pose, last_speed_bias, pose, speed_bias});
    }
  }
  const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
  // [end of quote]
  if (!summary.IsSolutionUsable()) {
    std::cerr << summary.message << '\n' << summary.detail << '\n';
    return 1;
  }
  const double* found = graph.Values(speed_bias);
  std::printf("%d iterations, %d times samples integrated anew\n", summary.num_successful_steps,
              summary.work.num_recentered_factors);
  std::printf("gyroscope's bias      %7.4f %7.4f %7.4f rad/s, truth %7.4f %7.4f %7.4f\n", found[3],
              found[4], found[5], kGyrBias[0], kGyrBias[1], kGyrBias[2]);
  std::printf("accelerometer's bias  %7.4f %7.4f %7.4f m/s², truth %7.4f %7.4f %7.4f\n", found[6],
              found[7], found[8], kAccBias[0], kAccBias[1], kAccBias[2]);
  double without[9] = {found[0], found[1], found[2]};
  const double time = (kNumFrames - 1) * kFrameSeconds;
  std::printf("two seconds on the IMU alone: %.3f m off, without biases %.3f m\n",
              ErrorAhead(graph.Values(pose), found, options, time),
              ErrorAhead(graph.Values(pose), without, options, time));
  return 0;
}
