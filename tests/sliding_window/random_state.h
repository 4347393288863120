#pragma once

#include <random>
#include <vector>

#include "common/frame.h"

namespace sliding_window {

/// States, poses and IMU samples at random, the same for the same seed.
class RandomState {
 public:
  explicit RandomState(unsigned seed) : random_(seed) {}

  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Eigen::Vector3d Vector(double size) {
    return {Uniform(-size, size), Uniform(-size, size), Uniform(-size, size)};
  }
  Pose AnyPose() { return {Vector(5.0), Exp(Vector(1.8))}; }
  ImuState AnyState() { return {AnyPose(), Vector(2.0), Vector(0.1), Vector(0.02)}; }

  /// 0.1 s of an IMU that is shaken.
  std::vector<ImuSample> Samples() {
    std::vector<ImuSample> samples;
    for (int i = 0; i <= 20; ++i) {
      samples.push_back({0.005 * i, kGravity + Vector(3.0), Vector(1.0)});
    }
    return samples;
  }

  std::mt19937& engine() { return random_; }

 private:
  std::mt19937 random_;
};

/// The four blocks of an IMU factor, as an estimator's `write` lays out a state.
inline std::vector<std::vector<double>> ImuValues(const ImuState& i, const ImuState& j,
                                                  void (*write)(const ImuState&, double*,
                                                                double*)) {
  std::vector<std::vector<double>> x{std::vector<double>(7), std::vector<double>(9),
                                     std::vector<double>(7), std::vector<double>(9)};
  write(i, x[0].data(), x[1].data());
  write(j, x[2].data(), x[3].data());
  return x;
}

inline std::vector<double> ToVector(const Pose& pose) {
  std::vector<double> x(7);
  pose.ToParameters(x.data());
  return x;
}

}  // namespace sliding_window
